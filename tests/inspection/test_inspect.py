"""The inspector: its parts sum to the tree, whatever the tree is made of."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial

from jaxrmp import (
    Affine,
    Batched,
    GeometricDynamicalSystem,
    Leaf,
    NaturalForm,
    Node,
    Pointwise,
    Scaled,
    SeparableGDS,
    ShapeError,
    Sum,
    acceleration,
    batched,
    certificate,
    map_tree,
    pullback,
    pytree,
    static,
)
from jaxrmp.inspection import inspect, table
from jaxrmp.kinematics import ControlPoints, panda
from jaxrmp.leaves import Attractor, Damping, JointLimit, Posture, lula

N = 4


@pytest.fixture(autouse=True)
def x64():
    with jax.enable_x64(True):
        yield


@pytree
class Drag(Leaf):
    """A leaf that is no geometric dynamical system."""

    gain: jax.Array | float = 2.0
    name: str = static(default="drag")
    certified = False

    def __call__(self, x, xd):
        eye = jnp.eye(x.shape[-1], dtype=x.dtype)
        return NaturalForm(-self.gain * jnp.abs(xd) * xd, jnp.broadcast_to(0.3 * eye, (*x.shape, x.shape[-1])))


@pytree
class Keep(SeparableGDS):
    """Damps distances [m]; its gap is the least of them."""

    weight: jax.Array | float = 0.5
    name: str = static(default="keep")

    def metric(self, x, xd):
        return self.weight / (1 + x * x)

    def potential(self, x):
        return 0.1 * jnp.exp(-x)

    def damping(self, x, xd):
        return jnp.full_like(x, 0.7)

    def gap(self, x):
        return x.min()


def bend(W, x):
    return jnp.tanh(W @ x) + 0.1 * jnp.sin(x[: W.shape[0]])


def points(W, x):
    return jnp.reshape(jnp.tanh(W @ x), (3, 2)) + 0.2 * x[0] * x[1]


def two_by_three(W, x):
    return jnp.reshape(jnp.sin(W @ x), (2, 3, 2))


def bowl_metric(A, x, xd):
    return jnp.eye(x.shape[0]) + 0.3 * jnp.sin(x[0]) ** 2 * A @ A.T


def bowl_potential(c, x):
    return jnp.sum(jnp.cosh(x - c))


def bowl_damping(A, x, xd):
    return A @ A.T * (1 + x @ x)


def bowl(seed, m, name):
    A = jnp.asarray(np.random.default_rng(seed).normal(size=(m, m)))
    return GeometricDynamicalSystem.of(
        Partial(bowl_metric, A), Partial(bowl_potential, A[0]), Partial(bowl_damping, A), name
    )


def tree():
    rng = np.random.default_rng(0)
    W, V, U = (jnp.asarray(rng.normal(size=size)) for size in ((2, N), (6, N), (12, N)))
    inner = pullback(Partial(bend, W), bowl(1, 2, "bowl") + Drag())
    affine = Pointwise(Affine(jnp.asarray(rng.normal(size=(2, 2))), jnp.asarray([0.1, 0.2])))
    cloud = pullback(Partial(points, V), pullback(affine, batched(*(bowl(k, 2, "cloud") for k in range(3)))))
    line = pullback(Affine(jnp.ones((1, 2)), jnp.zeros(1)), Keep())
    shared = pullback(Partial(points, V), Batched(Keep() + line, True))
    whole = pullback(Partial(points, V), Drag(0.1, name="all_points"))
    nested = pullback(Partial(two_by_three, U), Batched(Batched(bowl(7, 2, "nested") + Drag(0.4), True), True))
    return inner + cloud + shared + whole + nested + Drag(1.0, name="root_drag")


def states(count=5):
    rng = np.random.default_rng(1)
    return jnp.asarray(rng.uniform(-1, 1, (count, N))), jnp.asarray(rng.normal(size=(count, N)))


def test_the_parts_sum_to_the_tree():
    policy = tree()
    q, qd = states()
    found = jax.jit(jax.vmap(inspect, (None, 0, 0)))(policy, q, qd)

    @jax.jit
    @jax.vmap
    def whole(q, qd):
        form = policy(q, qd)
        energies = policy.energy(q, qd), policy.dissipation(q, qd)
        return form.f, form.M, acceleration(policy, q, qd), *energies

    sums = (found.f.sum(1), found.M.sum(1), found.acceleration.sum(1), found.energy.sum(1), found.dissipation.sum(1))
    for ours, expected in zip(sums, whole(q, qd), strict=True):
        np.testing.assert_allclose(ours, expected, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(found.force_share.sum(1), 1, rtol=1e-12)
    np.testing.assert_allclose(found.metric_share.sum(1), 1, rtol=1e-12)
    size = np.linalg.norm(found.f, axis=-1)
    np.testing.assert_allclose(found.force_share, size / size.sum(1, keepdims=True), rtol=1e-12)
    trace = np.trace(np.asarray(found.M), axis1=-2, axis2=-1)
    np.testing.assert_allclose(found.metric_share, trace / trace.sum(1, keepdims=True), rtol=1e-12)


def test_every_row_is_the_tree_with_that_leaf_alone():
    rng = np.random.default_rng(0)
    V = Partial(points, jnp.asarray(rng.normal(size=(6, N))))
    leaves = [bowl(k, 2, "cloud") for k in range(3)]
    q, qd = (a[0] for a in states())
    found = jax.jit(inspect)(pullback(V, batched(*leaves)) + Drag(), q, qd)
    assert found.names == ("cloud[0]", "cloud[1]", "cloud[2]", "drag")
    assert found.certified == (True, True, True, False)

    @jax.jit
    def alone(leaf, k):
        node = pullback(Partial(lambda V, k, x: V(x)[k], V, k), leaf)
        return node(q, qd), node.energy(q, qd), node.dissipation(q, qd)

    x, xd = jax.jvp(V, (q,), (qd,))
    for k, leaf in enumerate(leaves):
        form, energy, dissipation = alone(leaf, k)
        np.testing.assert_allclose(found.f[k], form.f, rtol=1e-10)
        np.testing.assert_allclose(found.M[k], form.M, rtol=1e-10)
        np.testing.assert_allclose(found.energy[k], energy, rtol=1e-10)
        np.testing.assert_allclose(found.dissipation[k], dissipation, rtol=1e-10)
        np.testing.assert_allclose(found.x[k], x[k], rtol=1e-12)
        np.testing.assert_allclose(found.xd[k], xd[k], rtol=1e-12)
        np.testing.assert_allclose(found.gap[k], leaf.gap(x[k]), rtol=1e-12)
    assert found.energy[3] == 0


def test_names_of_batches_within_batches_count_both():
    found = jax.eval_shape(inspect, tree(), *(a[0] for a in states()))
    nested = [name for name in found.names if name.startswith("nested")]
    assert nested == [f"nested[{j}][{i}]" for i in range(2) for j in range(3)]
    assert len(found.names) == len(found.x) == len(found.f) == len(found.certified)


def test_a_leaf_says_itself_how_far_it_is():
    assert Keep().gap(jnp.asarray([0.4, -0.2])) == -0.2


def test_a_leaf_without_fields_that_has_a_goal_has_it_at_the_origin():
    @pytree
    class Home(Drag):
        has_goal = True

    assert Home().gap(jnp.asarray([3.0, 4.0])) == 5
    np.testing.assert_array_equal(jax.grad(lambda x: Home().gap(x))(jnp.zeros(2)), 0)


def test_a_leaf_that_is_about_no_place_has_no_gap():
    assert all(jnp.isnan(leaf.gap(jnp.ones(2))) for leaf in (Drag(), Damping(), lula.Inertia()))
    found = jax.jit(inspect)(Damping() + Attractor(jnp.asarray([3.0, 4.0])), jnp.zeros(2), jnp.zeros(2))
    assert [line.split()[-3] for line in table(found).splitlines()[1:]] == ["5", "nan"]
    assert table(found, rows=0).splitlines()[1].split()[-3] == "5"


def test_the_leaves_of_the_library_say_it_too():
    x = jnp.asarray([0.9, -0.5])
    limits = JointLimit(-jnp.ones(2), jnp.ones(2))
    assert limits.gap(x) == pytest.approx(0.1) and limits.gap(x + 0.3) == pytest.approx(-0.2)
    assert Attractor(jnp.asarray([0.9, 1.5])).gap(x) == 2
    assert Posture(rest=jnp.asarray([0.9, 1.5])).gap(x) == 2
    assert Attractor(jnp.zeros(2)).gap(jnp.asarray([3.0, 4.0])) == 5


@pytree
class Blend(Node):
    """A kind of node that the library does not know: it says what it is made of, and no more."""

    one: Node
    two: Node
    share: jax.Array | float

    def accept(self, visitor, state):
        return visitor.visit_sum((Scaled(self.one, self.share), Scaled(self.two, 1 - self.share)), state)


def test_a_node_of_another_kind_is_evaluated_certified_inspected_and_mapped():
    one, two = bowl(0, N, "a"), Damping(0.5, 2.0) + Attractor(jnp.ones(N))
    blend = Blend(one, two, 0.3)
    q, qd = (a[0] for a in states())

    @jax.jit
    def look(blend):
        expected = jax.tree.map(lambda a, b: 0.3 * a + 0.7 * b, one.measure(q, qd), two.measure(q, qd))
        return blend.measure(q, qd), expected, inspect(blend, q, qd), certificate(blend, q, qd)

    found, expected, rows, certified = look(blend)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-12), found, expected)
    assert rows.names == ("a", "damping", "attractor") and [leaf.name for leaf in blend.leaves()] == [*rows.names]
    np.testing.assert_allclose(rows.f.sum(0), found.form.f, rtol=1e-12)
    assert certified.residual < 1e-12 and certified.voided_by == ()
    off = map_tree(blend, lambda leaf: Scaled(leaf, 0.0) if leaf.name == "a" else leaf)
    with_one_off, two_alone = jax.jit(lambda q, qd: (off(q, qd).f, two(q, qd).f))(q, qd)
    np.testing.assert_allclose(with_one_off, 0.7 * two_alone, rtol=1e-12)


def test_a_leaf_on_many_coordinates_makes_no_matrix_of_them():
    wide = Affine(np.ones((700, 2)), np.zeros(700))
    program = jax.make_jaxpr(lambda q: inspect(pullback(wide, Posture(jnp.zeros(700))), q, q).M)(jnp.ones(2))
    assert max(np.prod(v.aval.shape) for e in program.eqns for v in e.outvars) <= 700 * 2 * 2


def test_at_rest_without_forces_shares_and_gradients_are_finite():
    drag, zero = Drag(), jnp.zeros(N)
    found = inspect(drag, zero, zero)
    np.testing.assert_array_equal(found.force_share, 0)
    assert found.metric_share == 1
    slope = jax.jit(jax.jacfwd(lambda q, qd: inspect(Sum((drag, drag)), q, qd).force_share, argnums=1))(zero, zero)
    assert np.isfinite(slope).all()


def test_a_broken_leaf_shows_as_nan():
    found = jax.jit(inspect)(Drag(jnp.nan) + bowl(0, N, "a"), *(a[0] for a in states()))
    assert np.isnan(found.force_share).all() and np.isnan(found.f[0]).all() and np.isfinite(found.f[1]).all()
    assert "nan" in table(found)


def test_panda_in_single_precision_and_without_retracing():
    robot = panda()
    traces = []

    @jax.jit
    def run(goal, q, qd):
        traces.append(1)
        hand = pullback(ControlPoints(robot, "panda_hand_tcp"), Batched(bowl(0, 3, "hand"), True))
        return inspect(hand + JointLimit(robot.lower, robot.upper) + pullback(lambda q: q - goal, Drag()), q, qd)

    q = jnp.asarray((robot.lower + robot.upper) / 2, jnp.float32)
    found = run(q, q, q)
    run(q + 1, q, q)
    assert len(traces) == 1 and found.names == ("hand[0]", "joint_limit", "drag")
    assert found.f.shape == (3, 7) and found.M.shape == (3, 7, 7)


def test_the_table_is_sorted_and_marks_the_uncertified():
    q, qd = states()
    found = jax.jit(inspect)(tree(), q[0], qd[0])
    lines = table(found, rows=4).splitlines()
    assert lines[0].split() == ["leaf", "force", "metric", "|acceleration|", "gap", "energy", "dissipation"]
    order = np.argsort(-np.asarray(found.force_share))
    assert [line.split()[0] for line in lines[1:5]] == [found.names[i] for i in order[:4]]
    assert lines[5].startswith(f"{len(order) - 4} more")
    assert "voids the certificate" in lines[-1] and "root_drag *" in table(found, rows=99)
    shares = [float(line.split("%")[0].split()[-1]) for line in lines[1:6]]
    np.testing.assert_allclose(sum(shares), 100, atol=0.3)
    assert "*" not in table(jax.jit(inspect)(bowl(0, N, "a"), q[0], qd[0]))


def test_a_table_of_many_states_is_refused():
    found = jax.vmap(lambda q, qd: inspect(Drag(), q, qd))(*states())
    with pytest.raises(ShapeError, match=r"one state.*leading axes \(5,\)"):
        table(found)
