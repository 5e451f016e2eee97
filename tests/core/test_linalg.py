"""The written-out factorisations against LAPACK, in float64."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ShapeError
from jaxrmp._linalg import cholesky, cholesky_solve, lu_solve, solve_lower, solve_lower_transposed

pytestmark = pytest.mark.usefixtures("x64")
SIZES = [*range(1, 13), 20]


def spd(rng, shape, n):
    root = rng.normal(size=(*shape, n, n))
    return root @ np.swapaxes(root, -1, -2) + n * np.eye(n)


@jax.jit
def everything(A, unsymmetric, b):
    L = cholesky(A)
    return L, solve_lower(L, b), solve_lower_transposed(L, b), cholesky_solve(A, b), lu_solve(unsymmetric, b)


@pytest.mark.parametrize("n", SIZES)
def test_factors_and_solutions_agree_with_lapack_in_batches(n):
    rng = np.random.default_rng(n)
    for shape in [(2, 3)] if n != 3 else [(2, 3), (5,), ()]:
        A, b = spd(rng, shape, n), rng.normal(size=(*shape, n))
        skew = rng.normal(size=(*shape, n, n))
        unsymmetric = A + skew - np.swapaxes(skew, -1, -2)  # its symmetric part is A: no pivoting is needed
        L, y, z, solved, by_lu = everything(A, unsymmetric, b)

        def lapack(matrix, b=b):
            return np.linalg.solve(matrix, b[..., None])[..., 0]

        expected = np.linalg.cholesky(A)
        # Condition numbers here are below 1e2, so what differs from LAPACK is rounding.
        np.testing.assert_allclose(L, expected, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(y, lapack(expected), rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(z, lapack(np.swapaxes(expected, -1, -2)), rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(solved, lapack(A), rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(by_lu, lapack(unsymmetric), rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("n", [3, 9])
def test_gradients_agree_with_those_of_jax_lapack(n):
    rng = np.random.default_rng(n)
    root, b, weights = rng.normal(size=(n, n)), rng.normal(size=n), rng.normal(size=(n, n))

    def loss(factor, solve, lu):
        def of(root, b):
            A = root @ root.T + n * jnp.eye(n)
            skewed = A + jnp.tril(root) - jnp.tril(root).T
            return jnp.sum(weights * factor(A)) + jnp.sum(weights[0] * (solve(A, b) + lu(skewed, b) ** 2))

        return of

    ours = jax.jit(jax.grad(loss(cholesky, cholesky_solve, lu_solve), argnums=(0, 1)))(root, b)
    lapack = loss(jnp.linalg.cholesky, jnp.linalg.solve, jnp.linalg.solve)
    theirs = jax.jit(jax.grad(lapack, argnums=(0, 1)))(root, b)
    for a, e in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(a, e, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("n", [2, 6, 10])
def test_an_indefinite_matrix_gives_nan_and_leaves_the_rest_of_its_batch_alone(n):
    good = spd(np.random.default_rng(0), (), n)
    bad = good - np.linalg.eigvalsh(good).mean() * np.eye(n)
    b = np.ones((2, n))
    solved = np.asarray(cholesky_solve(jnp.asarray(np.stack([good, bad])), jnp.asarray(b)))
    np.testing.assert_allclose(solved[0], np.linalg.solve(good, b[0]), rtol=1e-11)
    assert np.isnan(solved[1]).any()
    assert np.isnan(np.asarray(cholesky(jnp.asarray(bad)))).any()


@pytest.mark.parametrize("n", [4, 10])
def test_cholesky_reads_the_lower_triangle_only(n):
    A = spd(np.random.default_rng(n), (), n)
    scribbled = np.tril(A) + np.triu(np.full((n, n), 7.0), 1)
    L = np.asarray(cholesky(jnp.asarray(scribbled)))
    np.testing.assert_allclose(L, np.linalg.cholesky(A), rtol=1e-12, atol=1e-12)
    assert (np.triu(L, 1) == 0).all()
    slope = jax.grad(lambda A: jnp.sum(cholesky_solve(A, jnp.ones(n)) ** 2))(jnp.asarray(scribbled))
    assert (np.triu(slope, 1) == 0).all() and (np.tril(slope) != 0).any()


@pytest.mark.parametrize("shape", [(3,), (3, 2), (4, 2, 3)])
@pytest.mark.parametrize("solve", [cholesky_solve, lu_solve, solve_lower])
def test_matrices_that_are_not_square_are_refused(shape, solve):
    with pytest.raises(ShapeError, match=r"square matrices \[\.\.\., n, n\]"):
        solve(jnp.ones(shape), jnp.ones(shape[:-1]))
    with pytest.raises(ShapeError, match="square"):
        cholesky(jnp.ones(shape))


def test_single_precision_stays_single():
    A, b = jnp.eye(3, dtype=jnp.float32), jnp.ones(3, jnp.float32)
    for y in everything(A, A, b):
        assert y.dtype == jnp.float32
