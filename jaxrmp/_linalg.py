"""Small dense linear algebra, written out for XLA.

jaxlib's batched LAPACK calls can deadlock on a CPU when one program holds several of them (seen with jax 0.10), and
for the sizes of a policy, 1 to about 32, they are slower than straight-line code that XLA fuses. So every
factorisation on a policy's path is here. The last axes hold the matrix; any leading axes are batch.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jax.lax import Precision

from ._errors import ShapeError

# Every product says its precision: by default an accelerator rounds to 10 bits (TF32) or 8 before it multiplies, which
# makes accelerations wrong by several percent.
matmul = partial(jnp.matmul, precision=Precision.HIGHEST)
einsum = partial(jnp.einsum, precision=Precision.HIGHEST)

AT_ZERO = 1e-20  # squares of lengths below it count as zero: 1e-10 m is nothing, and 1 over its cube overflows float32
_UNROLL = 8  # Up to here every entry is its own scalar, which XLA fuses; above, whole columns keep programs small.


def cholesky(A: jax.Array, unroll: bool = True) -> jax.Array:
    """Lower triangular L [..., n, n] with `L L^T = A`, from the lower triangle of A, symmetric positive definite.

    Where A is not positive definite the result holds NaN. Unless `unroll`, a small one is no fewer steps than a large
    one, which makes smaller programs.
    """
    n = _size(A)
    if n <= (_UNROLL if unroll else 0):
        zero = jnp.zeros_like(A[..., 0, 0])
        L = [[zero] * n for _ in range(n)]
        for j in range(n):
            L[j][j] = jnp.sqrt(A[..., j, j] - sum(L[j][k] * L[j][k] for k in range(j)))
            for i in range(j + 1, n):
                L[i][j] = (A[..., i, j] - sum(L[i][k] * L[j][k] for k in range(j))) / L[j][j]
        return jnp.stack([jnp.stack(row, axis=-1) for row in L], axis=-2)
    columns, rows = [], jnp.arange(n)
    for j in range(n):
        column = jnp.where(rows >= j, A[..., :, j] / jnp.sqrt(A[..., j, j])[..., None], 0)
        columns.append(column)
        A = A - column[..., :, None] * column[..., None, :]
    return jnp.stack(columns, axis=-1)


def solve_lower(L: jax.Array, b: jax.Array, unroll: bool = True) -> jax.Array:
    """Solve `L y = b` by forward substitution; L [..., n, n] lower triangular, b [..., n]; `unroll` as above."""
    n = _size(L)
    y: list[jax.Array] = []
    if n <= (_UNROLL if unroll else 0):
        for i in range(n):
            y.append((b[..., i] - sum(L[..., i, k] * y[k] for k in range(i))) / L[..., i, i])
    else:
        for i in range(n):
            y.append(b[..., i] / L[..., i, i])
            b = b - L[..., :, i] * y[i][..., None]
    return jnp.stack(y, axis=-1)


def solve_lower_transposed(L: jax.Array, b: jax.Array, unroll: bool = True) -> jax.Array:
    """Solve `L^T y = b` by back substitution; L [..., n, n] lower triangular, b [..., n]; `unroll` as above."""
    return solve_lower(jnp.swapaxes(L, -1, -2)[..., ::-1, ::-1], b[..., ::-1], unroll)[..., ::-1]


@jax.custom_jvp
def cholesky_solve(A: jax.Array, b: jax.Array) -> jax.Array:
    """Solve `A y = b` for A [..., n, n] symmetric positive definite and b [..., n]; NaN where A is not.

    Its slope is one more solution, `A dy = db - dA y`, and not one through the factors.
    """
    L = cholesky(A)
    return solve_lower_transposed(L, solve_lower(L, b))


@cholesky_solve.defjvp
def _cholesky_solve_slope(primals, tangents):
    (A, b), (dA, db) = primals, tangents
    L = cholesky(A, unroll=False)

    def solved(b):
        return solve_lower_transposed(L, solve_lower(L, b, unroll=False), unroll=False)

    below = jnp.tril(dA, -1)
    dA = below + jnp.swapaxes(below, -1, -2) + dA * jnp.eye(_size(A), dtype=dA.dtype)  # as the lower triangle says
    y = solved(b)
    return y, solved(db - matmul(dA, y[..., None])[..., 0])


def lu_solve(A: jax.Array, b: jax.Array) -> jax.Array:
    """Solve `A y = b` by elimination without pivoting; A [..., n, n], b [..., n].

    Fit for matrices whose symmetric part is positive definite, which need no pivoting.
    """
    n = _size(A)
    for k in range(n - 1):
        factor = A[..., k + 1 :, k] / A[..., k, k][..., None]
        b = b.at[..., k + 1 :].add(-factor * b[..., k][..., None])
        A = A.at[..., k + 1 :, :].add(-factor[..., :, None] * A[..., k, None, :])
    return solve_lower(A[..., ::-1, ::-1], b[..., ::-1])[..., ::-1]


def length(*v: jax.Array) -> jax.Array:
    """Length over the last axis of one array, or of vectors given by their components.

    Below 1e-10 it is zero and so are its derivatives: the second would overflow single precision.
    """
    square = jnp.sum(v[0] * v[0], axis=-1) if len(v) == 1 else sum(x * x for x in v)
    # The inner where keeps sqrt away from zero, where its slope is infinite and would turn the zero into NaN.
    at_zero = square < AT_ZERO
    return jnp.where(at_zero, 0.0, jnp.sqrt(jnp.where(at_zero, 1.0, square))).astype(v[0].dtype)


def _size(A: jax.Array) -> int:
    if A.ndim < 2 or A.shape[-1] != A.shape[-2]:
        raise ShapeError(f"expected square matrices [..., n, n], received shape {A.shape}.")
    return A.shape[-1]
