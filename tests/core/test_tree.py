"""The laws of the tree, in float64, over random nonlinear maps and metrics."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import (
    Affine,
    Batched,
    DiagonalForm,
    Distance,
    GeometricDynamicalSystem,
    Leaf,
    LeafError,
    NaturalForm,
    Pointwise,
    Scaled,
    ShapeError,
    Sum,
    acceleration,
    batched,
    certificate,
    compose,
    map_tree,
    pullback,
    pushforward,
    stack,
    uncertified_leaves,
)
from jaxrmp._pytree import pytree, static
from jaxrmp.leaves import Attractor, Damping, JointLimit

pytestmark = pytest.mark.usefixtures("x64")
STATES = 20


def states(seed, n, shape=(STATES,)):
    rng = np.random.default_rng(seed)
    return jnp.asarray(rng.uniform(-0.9, 0.9, (*shape, n))), jnp.asarray(rng.normal(size=(*shape, n)))


@jax.jit
def evaluate(nodes, x, xd):
    """Force, metric, energy and dissipation of each node over a batch of states."""

    def one(node):
        def at(x, xd):
            form = node(x, xd)
            return form.f, form.M, node.energy(x, xd), node.dissipation(x, xd)

        return jax.vmap(at)(x, xd)

    return [one(node) for node in nodes]


def assert_same_policy(a, b, x, xd, tolerance=1e-11):
    ours, theirs = evaluate((a, b), x, xd)
    for name, one, two in zip(("f", "M", "energy", "dissipation"), ours, theirs, strict=True):
        np.testing.assert_allclose(one, two, rtol=tolerance, atol=tolerance, err_msg=name)


@pytest.mark.parametrize("speed", [0.0, 0.5])
def test_pullback_through_a_composition_is_the_pullback_of_the_pullback(random_map, random_gds, speed):
    first, second, leaf = random_map(0, 4, 5), random_map(1, 5, 3), random_gds(2, 3, speed)
    assert_same_policy(pullback(compose(first, second), leaf), pullback(first, pullback(second, leaf)), *states(0, 4))


def test_pullback_of_a_sum_is_the_sum_of_the_pullbacks(random_map, random_gds):
    psi, a, b = random_map(0, 4, 3), random_gds(1, 3), random_gds(2, 3, 0.5)
    assert_same_policy(pullback(psi, a + b), pullback(psi, a) + pullback(psi, b), *states(1, 4))


def test_pullback_is_equation_9(random_map, random_gds):
    """With Jdot by finite differences along the motion, rather than by the library's own pushforward."""
    psi, leaf = random_map(0, 4, 3), random_gds(1, 3)
    x, xd = (a[0] for a in states(2, 4))
    h = 1e-6
    jacobian = jax.jit(jax.jacfwd(psi))
    J, before, after = (np.asarray(jacobian(x + t * xd)) for t in (0, -h, h))
    form = jax.jit(leaf)(psi(x), J @ xd)
    f = J.T @ (form.f - form.M @ ((after - before) / (2 * h)) @ xd)
    pulled = jax.jit(pullback(psi, leaf))(x, xd)
    np.testing.assert_allclose(pulled.f, f, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(pulled.M, J.T @ np.asarray(form.M) @ J, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(pullback(psi, leaf).energy(x, xd), leaf.energy(psi(x), J @ xd), rtol=1e-12)


def test_a_batched_node_equals_the_sum_of_its_nodes(random_map, random_gds):
    maps = [random_map(k, 4, 3) for k in range(3)]
    leaves = [random_gds(10 + k, 3) for k in range(3)]
    points = jax.tree_util.Partial(lambda maps, x: jnp.stack([psi(x) for psi in maps]), maps)
    one_by_one = Sum(tuple(pullback(psi, leaf) for psi, leaf in zip(maps, leaves, strict=True)))
    assert_same_policy(pullback(points, batched(*leaves)), one_by_one, *states(3, 4))

    shared = Batched(leaves[0], shared=True)
    assert_same_policy(pullback(points, shared), Sum(tuple(pullback(psi, leaves[0]) for psi in maps)), *states(4, 4))


def test_a_pullback_between_spaces_of_points_stays_block_diagonal(random_map, random_gds):
    bend = random_map(0, 3, 2)
    leaves = [random_gds(k, 2) for k in range(3)]
    x, xd = states(5, 3, (3,))
    form = jax.jit(pullback(Pointwise(bend), batched(*leaves)))(x, xd)
    pulled = jax.jit(lambda leaf, x, xd: pullback(bend, leaf)(x, xd))
    assert form.f.shape == (3, 3) and form.M.shape == (3, 3, 3)
    for k in range(3):
        single = pulled(leaves[k], x[k], xd[k])
        np.testing.assert_allclose(form.f[k], single.f, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(form.M[k], single.M, rtol=1e-11, atol=1e-12)


def test_batched_parameters_need_one_common_leading_axis(random_gds):
    with pytest.raises(ShapeError, match=r"common leading axis, received leading axes.*shared=True"):
        Batched(random_gds(0, 3))
    with pytest.raises(ShapeError, match="common leading axis"):
        Batched(Damping())  # numbers have no axes at all
    with pytest.raises(ShapeError, match=r"\(2,\), \(3,\)"):
        Batched(Damping(jnp.ones(2), jnp.ones(3)))
    with pytest.raises(ShapeError, match="at least one node"):
        batched()


def test_batching_stacks_plain_numbers_too():
    two = batched(Damping(1.0, 2.0), Damping(3.0, 4.0))
    form = two(jnp.zeros((2, 1)), jnp.ones((2, 1)))
    np.testing.assert_allclose(form.M.ravel(), [1, 3])
    np.testing.assert_allclose(form.f.ravel(), [-2, -12])
    np.testing.assert_allclose(two.dissipation(jnp.zeros((2, 1)), jnp.ones((2, 1))), 14)


def whole_tree(random_map, random_gds):
    """A tree on R^4 with every kind of node."""
    points = jax.tree_util.Partial(
        lambda maps, x: jnp.stack([psi(x) for psi in maps]), [random_map(k, 4, 3) for k in (0, 1)]
    )
    return (
        pullback(points, batched(random_gds(2, 3), random_gds(3, 3)))
        + pullback(compose(random_map(4, 4, 3), Distance(jnp.ones(3), 0.1)), random_gds(5, 1, 0.5, "obstacle"))
        + JointLimit(-jnp.ones(4), jnp.ones(4), sigma=1.0)
        + Damping(0.1, 2.0)
    )


def test_the_root_metric_is_symmetric_and_positive_definite(random_map, random_gds):
    ((_, M, _, dissipation),) = evaluate((whole_tree(random_map, random_gds),), *states(6, 4))
    np.testing.assert_allclose(M, np.swapaxes(M, -1, -2), rtol=1e-12, atol=1e-13)
    assert np.linalg.eigvalsh(np.asarray(M)).min() >= 0.1 - 1e-9  # the damping leaf's weight
    assert (np.asarray(dissipation) >= 0).all()


def test_changing_parameters_does_not_retrace(random_map, random_gds):
    traces = []

    @jax.jit
    def qdd(tree, q, qd):
        traces.append(1)
        return acceleration(tree, q, qd)

    tree = pullback(random_map(0, 4, 3), random_gds(1, 3)) + Damping(0.1, 2.0)
    fresh = jax.jit(acceleration)
    q, qd = (a[0] for a in states(7, 4))
    results = [qdd(tree, q, qd)]
    for scale in (1.1, 1.2):
        scaled = jax.tree.map(lambda a, scale=scale: a * scale, tree)
        results.append(qdd(scaled, q, qd))
        np.testing.assert_allclose(results[-1], fresh(scaled, q, qd), rtol=1e-10)
    assert len(traces) == 1
    assert not np.allclose(results[0], results[1])

    renamed = Damping(0.1, 2.0, name="another")  # structure, unlike a gain, is part of the program
    qdd(Sum((*tree.nodes[:-1], renamed)), q, qd)
    assert len(traces) == 2


def test_gradients_reach_every_gain_and_agree_with_differences(random_map, random_gds):
    psi, leaf = random_map(0, 3, 2), random_gds(1, 2)
    q, qd = (a[0] for a in states(8, 3))

    def tree(gains):
        limit = JointLimit(gains[0] - 2, gains[0] + 2, weight=gains[1], sigma=gains[2], stiffness=gains[3])
        return pullback(psi, leaf) + limit + Damping(gains[4], gains[5])

    def loss(gains):
        return jnp.sum(acceleration(tree(gains), q, qd) ** 2)

    gains = jnp.asarray([0.1, 0.5, 0.8, 0.7, 0.2, 1.5])
    slope = np.asarray(jax.jit(jax.grad(loss))(gains))
    compiled, h = jax.jit(loss), 1e-6
    numeric = [(compiled(gains + h * e) - compiled(gains - h * e)) / (2 * h) for e in np.eye(6)]
    np.testing.assert_allclose(slope, numeric, rtol=1e-5, atol=1e-7)
    assert (np.abs(slope) > 1e-6).all()


def test_vmap_over_trees_is_the_trees_one_by_one(random_gds):
    trees = [random_gds(k, 3) + Damping(0.1 * (k + 1), 1.0) for k in range(4)]
    stacked = jax.tree.map(lambda *a: jnp.stack([jnp.asarray(v) for v in a]), *trees)
    q, qd = (a[0] for a in states(9, 3))
    together = jax.jit(jax.vmap(acceleration, in_axes=(0, None, None)))(stacked, q, qd)
    for k, tree in enumerate(trees):
        np.testing.assert_allclose(together[k], jax.jit(acceleration)(tree, q, qd), rtol=1e-10)


def test_second_derivatives_of_a_policy_agree_with_differences(random_map, random_gds):
    tree = pullback(random_map(0, 3, 2), random_gds(1, 2, 0.5)) + JointLimit(-jnp.ones(3), jnp.ones(3), sigma=1.0)
    tree = tree + Damping(0.1)
    q, qd = (a[0] for a in states(10, 3))
    v = jnp.asarray([0.3, -0.5, 0.2])

    @jax.jit
    def along(t):
        return acceleration(tree, q + t * v, qd, "lu")

    def first(t):
        return jax.jvp(along, (t,), (1.0,))[1]

    second = jax.jit(lambda t: jax.jvp(first, (t,), (1.0,))[1])(0.0)
    h = 1e-4
    np.testing.assert_allclose(second, (along(h) - 2 * along(0.0) + along(-h)) / h**2, rtol=1e-5, atol=1e-4)


def test_sums_flatten_and_leaves_come_in_order(random_map, random_gds):
    a, b, c, d = (random_gds(k, 3, name=name) for k, name in enumerate("abcd"))
    total = (a + b) + (c + d)
    assert isinstance(total, Sum) and total.nodes == (a, b, c, d)
    tree = pullback(random_map(0, 4, 3), total) + pullback(random_map(1, 4, 1), Batched(Damping(), shared=True))
    assert [leaf.name for leaf in tree.leaves()] == ["a", "b", "c", "d", "damping"]
    with pytest.raises(TypeError, match="unsupported operand"):
        a + 1  # type: ignore[operator]


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_the_motion_does_not_depend_on_the_coordinates(random_diffeomorphism, random_gds, speed):
    """If y = psi(x) is one to one, the policy pulled back to x moves y exactly as the policy on y does."""
    A = jnp.asarray(np.eye(3) + 0.3 * np.random.default_rng(0).normal(size=(3, 3)))
    tree = random_gds(1, 3, speed) + Damping(0.3, 1.0)
    method = "lu" if speed else "cholesky"

    @jax.jit
    @jax.vmap
    def residuals(x, xd):
        linear = A @ acceleration(pullback(Affine(A, jnp.ones(3)), tree), x, xd, method) - acceleration(
            tree, A @ x + 1, A @ xd, method
        )
        bent = random_diffeomorphism(2, 3)
        there = pushforward(bent, x, xd)
        ydd = there.J @ acceleration(pullback(bent, tree), x, xd, method) + there.c
        return linear, ydd - acceleration(tree, there.y, there.yd, method)

    for residual in residuals(*states(11, 3)):
        np.testing.assert_allclose(residual, 0, atol=1e-10)


@pytree
class Push(Leaf):
    """A constant force: no geometric dynamical system."""

    force: jax.Array
    name: str = static(default="push")
    certified = False

    def __call__(self, x, xd):
        return NaturalForm(self.force, jnp.eye(x.shape[0], dtype=x.dtype))


def test_a_leaf_outside_the_certificate_is_named_and_breaks_it(random_map, random_gds):
    certified = random_gds(0, 3) + Damping()
    assert uncertified_leaves(certified) == ()
    tree = certified + pullback(stack(random_map(0, 3, 2)), Push(jnp.ones(2), "shove")) + Push(jnp.ones(3))
    assert uncertified_leaves(tree + Push(jnp.ones(3))) == ("shove", "push")
    assert isinstance(next(iter(certified.leaves())), GeometricDynamicalSystem)
    x, xd = (a[0] for a in states(12, 3))
    (whole, energy, dissipation), (broken, *same) = jax.jit(
        lambda: [(certificate(t, x, xd), t.energy(x, xd), t.dissipation(x, xd)) for t in (certified, tree)]
    )()
    np.testing.assert_allclose(same, (energy, dissipation))
    assert whole.residual < 1e-12 and whole.voided_by == ()
    assert broken.residual > 1e-3 and broken.voided_by == ("shove", "push")
    batch = jax.jit(jax.vmap(certificate, (None, 0, 0)))(tree, *states(12, 3, (2,)))
    assert batch.residual.shape == (2,) and batch.voided_by == ("shove", "push")


def test_replacing_a_frozen_field_keeps_the_rest():
    damping = replace(Damping(0.5, 3.0), weight=0.7)
    assert (damping.weight, damping.damping_rate) == (0.7, 3.0)
    with pytest.raises(AttributeError, match="cannot assign"):
        damping.weight = 1.0  # type: ignore[misc]


def test_a_leaf_that_a_tree_would_pass_over_cannot_be_written():
    with pytest.raises(LeafError, match="Softer overrides __call__ alone.*override evaluate"):

        class Softer(Damping):
            def __call__(self, x, xd):
                return NaturalForm(-0.5 * xd, jnp.eye(2))

    with pytest.raises(LeafError, match="Heavier overrides evaluate alone.*override __call__"):

        class Heavier(Attractor):
            def evaluate(self, x, xd):
                return DiagonalForm(x, x)

    class Both(Damping):
        def evaluate(self, x, xd):
            return DiagonalForm(-0.5 * xd, jnp.ones_like(x))

    x = jnp.ones(2)
    np.testing.assert_array_equal(Both()(x, x).f, (Both() + Damping(0.0))(x, x).f)


def test_plain_functions_are_task_maps_under_jit_and_vmap_over_trees():
    scale = jnp.asarray(2.0)
    points = compose(lambda q: jnp.stack([q, q + 1]), Pointwise(lambda p: p[:1]))
    tree = pullback(lambda q: scale * q[:2], Attractor(jnp.ones(2))) + Damping(0.1)
    tree = tree + pullback(points, Batched(Damping(), shared=True))
    q, qd = (a[0] for a in states(13, 3))
    np.testing.assert_allclose(jax.jit(acceleration)(tree, q, qd), acceleration(tree, q, qd), rtol=1e-12)
    trees = jax.tree.map(lambda a: jnp.stack([jnp.asarray(a), 2 * jnp.asarray(a)]), tree)
    both = jax.jit(jax.vmap(acceleration, (0, None, None)))(trees, q, qd)
    np.testing.assert_allclose(both[0], jax.jit(acceleration)(tree, q, qd), rtol=1e-12)
    free = GeometricDynamicalSystem.of(lambda x, xd: jnp.eye(3), lambda x: x @ x, lambda x, xd: jnp.eye(3))
    np.testing.assert_allclose(jax.jit(acceleration)(free, q, qd), -2 * q - qd, rtol=1e-12)


def test_what_is_measured_together_is_what_each_function_gives(random_map, random_gds):
    tree = whole_tree(random_map, random_gds)
    x, xd = states(14, 4)

    @jax.jit
    @jax.vmap
    def both(x, xd):
        return tree.measure(x, xd), (tree.evaluate(x, xd), tree.energy(x, xd), tree.dissipation(x, xd))

    together, apart = both(x, xd)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-12), tuple(together), apart)


def test_a_sum_of_nothing_is_no_policy(random_gds):
    leaf, nothing = random_gds(0, 3), Sum(())
    x, xd = (a[0] for a in states(15, 3))
    jax.tree.map(np.testing.assert_array_equal, (leaf + nothing).measure(x, xd), leaf.measure(x, xd))
    assert not np.any(nothing(x, xd).M) and nothing.energy(x, xd) == 0 and nothing.leaves() == ()


def test_a_tree_is_mapped_leaf_by_leaf_and_map_by_map(random_map, random_gds):
    tree = whole_tree(random_map, random_gds)
    x, xd = (a[0] for a in states(16, 4))
    off = map_tree(tree, lambda leaf: Scaled(leaf, 0.0) if leaf.name == "gds" else leaf)
    assert_same_policy(off, Sum(tree.nodes[1:]), *states(16, 4), 1e-12)
    moved = map_tree(
        pullback(Affine(jnp.eye(4), jnp.zeros(4)), Attractor(jnp.ones(4))),
        lambda leaf: replace(leaf, goal=2 * leaf.goal),
        lambda task_map: replace(task_map, b=jnp.ones(4)),
    )
    np.testing.assert_allclose(moved(x, xd).f, Attractor(2 * jnp.ones(4))(x + 1, xd).f, rtol=1e-12)
    assert jax.tree.structure(map_tree(tree)) == jax.tree.structure(tree)


def test_a_map_and_a_policy_that_are_swapped_are_told():
    with pytest.raises(TypeError, match="Swap"):
        pullback(Damping(), Affine(jnp.eye(2), jnp.zeros(2)))
