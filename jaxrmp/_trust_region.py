"""Resolving a policy inside a bound on its acceleration."""

import jax
import jax.numpy as jnp

from ._forms import NaturalForm
from ._linalg import cholesky, matmul, solve_lower, solve_lower_transposed
from ._ranges import require_number

_MOST_STEPS = 50  # Newton's steps rise to the root without overshoot; two to five are usual.


def resolve_within(form: NaturalForm, max_norm: jax.Array | float, tolerance: jax.Array | float = 1e-2) -> jax.Array:
    """The acceleration that a policy asks for, held inside `|a| <= max_norm` by a trust region rather than a clip.

    `a = (M + lambda I)^-1 f`, with `lambda = 0` where `|M^-1 f| <= max_norm`, else the one `lambda > 0` for which
    `|a| = max_norm`. Where a clip would shorten the acceleration, this turns it too: towards the directions that
    the policy holds important.

    **Arguments**: `form`, `f` [n] and `M` [n, n], symmetric and positive semi-definite; `max_norm`, positive, in units
    of x per second squared; `tolerance` on `|a|`, same units: the search for lambda stops inside it, and one more
    step of Newton's follows.
    **Returns** `a` [n]. Differentiable once through lambda (by that last step, which is the implicit function theorem);
    under `vmap` a batch takes as many steps as its slowest member. A singular `M` is resolved wherever its force is
    larger than the bound allows; elsewhere the result is NaN, as from `resolve`.
    **Raises** `ConfigurationError` for a bound or a tolerance that is not positive.

    >>> a = resolve_within(NaturalForm(jnp.array([30.0, 40.0]), jnp.eye(2)), max_norm=5.0)
    >>> [round(v, 2) for v in a.tolist()]
    [3.0, 4.0]

    More and Sorensen 1983, section 3: Newton's method on `1 / |a(lambda)|`, which is concave and rising.
    """
    require_number("resolve_within", "max_norm", max_norm)
    require_number("resolve_within", "tolerance", tolerance)
    f, M = form.f, form.M
    eye = jnp.eye(f.shape[-1], dtype=f.dtype)
    f_now, M_now, bound = jax.lax.stop_gradient((f, M, jnp.asarray(max_norm, f.dtype)))
    resolution = 16 * jnp.finfo(f.dtype).eps
    trace = jnp.trace(M_now)  # no eigenvalue is above it, so the start below is not above the root
    least = resolution * trace
    enough = jnp.maximum(jax.lax.stop_gradient(jnp.asarray(tolerance, f.dtype)), resolution * bound)

    def accelerate(shift):
        L = cholesky(M_now + shift * eye)
        return L, solve_lower_transposed(L, solve_lower(L, f_now))

    def rise(L, a, bound):
        """Newton's step in lambda."""
        w = solve_lower(L, a)
        square = matmul(a, a)
        return square / matmul(w, w) * (jnp.sqrt(square) - bound) / bound

    def is_far(state):
        step, _, L_and_a = state
        return (step < _MOST_STEPS) & (jnp.abs(_norm(L_and_a[1]) - bound) > enough)

    def advance(state):
        step, shift, (L, a) = state
        shift = jnp.maximum(shift + rise(L, a, bound), least)
        return step + 1, shift, accelerate(shift)

    is_within = _norm(accelerate(jnp.zeros_like(bound))[1]) <= bound
    start = jnp.maximum(_norm(f_now) / bound - trace, least)
    # A member that is within already must not keep the others of its batch busy.
    steps = jnp.where(is_within, _MOST_STEPS, 0)
    _, shift, _ = jax.lax.while_loop(is_far, advance, (steps, start, accelerate(start)))

    # The last step sees how f, M and the bound move the root.
    L = cholesky(M + shift * eye)
    a = jnp.where(is_within, jnp.ones_like(f), solve_lower_transposed(L, solve_lower(L, f)))
    shift = jnp.where(is_within, 0, shift + rise(L, a, jnp.asarray(max_norm, f.dtype)))
    L = cholesky(M + shift * eye)
    return solve_lower_transposed(L, solve_lower(L, f))


def _norm(a: jax.Array) -> jax.Array:
    return jnp.sqrt(matmul(a, a))
