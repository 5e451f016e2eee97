"""Forms pulled back through distances, point by point, against the Jacobian of all distances by autodiff."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import DiagonalForm, NaturalForm, RigidTransform, Translation, certificate, compose, pullback, transport
from jaxrmp._task_map import pull_form, pushforward_by_autodiff, transport_by_jacobian
from jaxrmp.kinematics import ControlPoints, load_robot
from jaxrmp.leaves import CollisionAvoidance, Damping
from jaxrmp.world import ObstacleDistances, SelfDistances
from jaxrmp.xla import concatenated, materialise

from .conftest import moving_points, random_poses, random_state, random_world

pytestmark = pytest.mark.usefixtures("x64")
RADII = jnp.asarray([0.02, 0.05, 0.0, 0.1, 0.07])


def states():
    """Eight positions and velocities, [8, 7] each."""
    return tuple(jnp.stack(part) for part in zip(*(random_state(seed) for seed in range(8)), strict=True))


def obstacle_distances():
    T = random_poses(np.random.default_rng(5), 1)[0]
    points = compose(moving_points(1), RigidTransform(jnp.asarray(T)), Translation(jnp.full((5, 3), 0.1)))
    return ObstacleDistances(points, random_world(0), RADII)


MAPS = {
    "obstacles": obstacle_distances,
    "self": lambda: SelfDistances(moving_points(2), ((0, 1), (0, 4), (3, 2)), RADII),
}


def random_forms(size):
    """A diagonal and a dense form."""
    rng = np.random.default_rng(7)
    f, M = jnp.asarray(rng.normal(size=size)), jnp.asarray(rng.normal(size=(size, size)))
    return DiagonalForm(f, M[0] ** 2), NaturalForm(f, M)


@pytest.mark.parametrize("name", list(MAPS))
def test_forms_are_pulled_back_as_through_the_jacobian_by_autodiff(name):
    psi, (X, XD) = MAPS[name](), states()
    forms = random_forms(jax.eval_shape(psi, X[0]).size)

    def ours(x, xd):
        y, yd, pull = transport(psi, x, xd)
        return y, yd, [pull(form).dense() for form in forms]

    def theirs(x, xd):
        at = pushforward_by_autodiff(psi, x, xd)
        return at.y, at.yd, [pull_form(at, form.dense(), 1) for form in forms]

    batch, expected = jax.jit(jax.vmap(ours))(X, XD), jax.jit(jax.vmap(theirs))(X, XD)
    alone = jax.jit(ours)(X[0], XD[0])
    for a, one, e in zip(*(jax.tree.leaves(found) for found in (batch, alone, expected)), strict=True):
        np.testing.assert_allclose(a, e, rtol=0, atol=1e-10 * np.abs(e).max())
        np.testing.assert_allclose(one, e[0], rtol=0, atol=1e-10 * np.abs(e).max())


BRANCHING = Path(__file__).parents[1] / "kinematics" / "models" / "branching.xml"


def robot_and_its_own_distances():
    """Between links of one branch, of two branches, of a branch and the world; joints that slide, follow, lock."""
    robot = load_robot(BRANCHING)
    frames = [name for name in robot.frame_names if not name.startswith("site:")]
    points = ControlPoints(robot, tuple(frames), 0.3 * np.random.default_rng(1).normal(size=(len(frames), 3)))
    pairs = [(i, j) for i in range(len(frames)) for j in range(i)]
    return robot, SelfDistances(points, pairs, 0.01)


def test_forms_are_pulled_back_through_lines_on_a_robot_as_through_jacobians_of_its_points():
    robot, psi = robot_and_its_own_distances()
    rng = np.random.default_rng(3)
    X, XD = jnp.asarray(rng.normal(size=(2, 8, robot.num_joints)))
    forms = random_forms(len(psi.pairs))

    def by(transport):
        def carry(x, xd):
            y, yd, pull = transport(psi, x, xd)
            return y, yd, [pull(form) for form in forms]

        return carry

    expected = jax.jit(jax.vmap(by(transport_by_jacobian)))(X, XD)
    found = jax.jit(jax.vmap(by(transport)))(X, XD)
    alone = jax.jit(by(transport))(X[0], XD[0])
    for a, one, e in zip(*(jax.tree.leaves(part) for part in (found, alone, expected)), strict=True):
        assert np.abs(e).max() > 0.1
        np.testing.assert_allclose(a, e, rtol=0, atol=1e-10 * np.abs(e).max())
        np.testing.assert_allclose(one, e[0], rtol=0, atol=1e-10 * np.abs(e).max())


def test_slopes_through_a_pulled_back_leaf_are_finite_and_its_certificate_holds():
    tree = pullback(obstacle_distances(), CollisionAvoidance(barrier=1e-2, reach=0.5)) + Damping(0.1, 1.0)

    @jax.jit
    @jax.vmap
    def check(x, xd):
        slope = jax.grad(lambda x, xd: jnp.sum(tree(x, xd).f) + jnp.sum(tree(x, xd).M), argnums=(0, 1))(x, xd)
        return certificate(tree, x, xd).residual, slope

    residual, slopes = check(*states())
    assert np.max(residual) <= 1e-8
    assert all(np.isfinite(part).all() for part in slopes)


def test_concatenating_by_one_loop_is_concatenating():
    rng = np.random.default_rng(0)
    a, b, c = (jnp.asarray(rng.normal(size=(4, k)), jnp.float32) for k in (1, 3, 3))
    one = jnp.arange(1.0, dtype=jnp.float32)

    def joined(a, b, c):  # a group of which a part is known, and one that is all in the batch
        return jnp.stack(concatenated([[one, b], [a, c]]))

    def plainly(a, b, c):
        return jnp.stack([jnp.concatenate([one, b]), jnp.concatenate([a, c])])

    def slopes(function):
        return jax.grad(lambda *given: jnp.sum(function(*given)[1] ** 3), argnums=(0, 1, 2))

    def over_rows(function):
        return lambda a, b, c: jax.vmap(function, (None, None, 0))(a, b, jnp.stack([c, 2 * c]))

    for change in (lambda function: function, slopes, jax.jacfwd, over_rows):
        found, wanted = (jax.jit(jax.vmap(change(function)))(a, b, c) for function in (joined, plainly))
        jax.tree.map(np.testing.assert_array_equal, found, wanted)
    np.testing.assert_array_equal(joined(a[0], b[0], c[0]), plainly(a[0], b[0], c[0]))


@pytest.mark.parametrize("shape", [(7,), (37,), (5, 8), (4, 13, 3), (0,), (6, 17)])
def test_materialising_changes_nothing(shape):
    x = jnp.asarray(np.random.default_rng(0).normal(size=(3, *shape)))
    np.testing.assert_array_equal(jax.jit(jax.vmap(materialise))(x), x)
    np.testing.assert_array_equal(materialise(x[0]), x[0])
    np.testing.assert_array_equal(jax.vmap(jax.grad(lambda x: jnp.sum(materialise(x) ** 2)))(x), 2 * x)
