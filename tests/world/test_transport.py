"""Forms pulled back through distances, point by point, against the Jacobian of all distances by autodiff."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import DiagonalForm, NaturalForm, RigidTransform, Translation, certificate, compose, pullback, transport
from jaxrmp._materialise import materialise
from jaxrmp._task_map import pull_form, pushforward_by_autodiff
from jaxrmp.leaves import CollisionAvoidance, Damping
from jaxrmp.world import ObstacleDistances, SelfDistances

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


def random_form(size, dense):
    rng = np.random.default_rng(7)
    f, M = rng.normal(size=size), rng.normal(size=(size, size))
    return (
        NaturalForm(jnp.asarray(f), jnp.asarray(M)) if dense else DiagonalForm(jnp.asarray(f), jnp.asarray(M[0] ** 2))
    )


@pytest.mark.parametrize("dense", [False, True], ids=["diagonal", "dense"])
@pytest.mark.parametrize("name", list(MAPS))
def test_forms_are_pulled_back_as_through_the_jacobian_by_autodiff(name, dense):
    psi, (X, XD) = MAPS[name](), states()
    form = random_form(jax.eval_shape(psi, X[0]).size, dense)

    def ours(x, xd):
        y, yd, pull = transport(psi, x, xd)
        pulled = pull(form).dense()
        return y, yd, pulled.f, pulled.M

    def theirs(x, xd):
        at = pushforward_by_autodiff(psi, x, xd)
        pulled = pull_form(at, form.dense(), 1)
        return at.y, at.yd, pulled.f, pulled.M

    batch, expected = jax.jit(jax.vmap(ours))(X, XD), jax.jit(jax.vmap(theirs))(X, XD)
    alone = jax.jit(ours)(X[0], XD[0])
    for a, one, e in zip(batch, alone, expected, strict=True):
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


@pytest.mark.parametrize("shape", [(7,), (37,), (5, 8), (4, 13, 3), (0,), (6, 17)])
def test_materialising_changes_nothing(shape):
    x = jnp.asarray(np.random.default_rng(0).normal(size=(3, *shape)))
    np.testing.assert_array_equal(jax.jit(jax.vmap(materialise))(x), x)
    np.testing.assert_array_equal(materialise(x[0]), x[0])
    np.testing.assert_array_equal(jax.vmap(jax.grad(lambda x: jnp.sum(materialise(x) ** 2)))(x), 2 * x)
