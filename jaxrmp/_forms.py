"""The two forms of a Riemannian motion policy, and the step from one to the other.

An RMP on an m-dimensional space is an acceleration policy with a metric that is its state-dependent importance:
canonical form (a, M), natural form [f, M] with `f = M a`. Natural forms add; accelerations do not, so the canonical
form has no `+`. RMPflow (Cheng et al. 2018), section 3.1.
"""

from typing import Literal, get_args

import jax
import jax.numpy as jnp

from ._errors import ShapeError, UnknownNameError
from ._linalg import cholesky_solve, einsum, lu_solve
from ._pytree import pytree
from .xla import materialise, one_loop

Method = Literal["cholesky", "pinv", "lu"]


@pytree
class NaturalForm:
    """Force and metric of a policy: `f = M a`.

    `f` [m], in units of energy per unit of x, and `M` [m, m]. Over K points the form is block diagonal: `f` [K, m],
    `M` [K, m, m].
    """

    f: jax.Array
    M: jax.Array

    def __add__(self, other: "NaturalForm") -> "NaturalForm":
        if not isinstance(other, NaturalForm):
            return NotImplemented
        _refuse_other_space(self, other)
        return NaturalForm(self.f + other.f, self.M + other.M)

    def dense(self) -> "NaturalForm":
        """This form itself; a `DiagonalForm` fills its metric out here."""
        return self


@pytree
class DiagonalForm:
    """A natural form whose metric is diagonal: policies of one dimension each, side by side.

    `f` [..., m], and `d` [..., m], the diagonal of M. What a thousand distances ask for takes a thousand numbers so,
    and not a million.
    """

    f: jax.Array
    d: jax.Array

    def __add__(self, other: "DiagonalForm | NaturalForm") -> "DiagonalForm | NaturalForm":
        if isinstance(other, NaturalForm):
            return self.dense() + other
        if not isinstance(other, DiagonalForm):
            return NotImplemented
        _refuse_other_space(self, other)
        return DiagonalForm(self.f + other.f, self.d + other.d)

    def __radd__(self, other: NaturalForm) -> NaturalForm:
        return other + self.dense() if isinstance(other, NaturalForm) else NotImplemented

    def dense(self) -> NaturalForm:
        """The same form with its metric as a matrix."""
        d = jnp.broadcast_to(self.d, self.f.shape)
        return NaturalForm(self.f, d[..., None] * jnp.eye(d.shape[-1], dtype=d.dtype))


Form = NaturalForm | DiagonalForm


@pytree
class CanonicalForm:
    """Acceleration and metric of a policy: `a` [m], units of x per second squared, and `M` [m, m]."""

    a: jax.Array
    M: jax.Array


def natural(form: CanonicalForm) -> NaturalForm:
    """The natural form of a policy given by its acceleration, `form`: `f = M a`."""
    return NaturalForm(einsum("...ij,...j->...i", form.M, form.a), form.M)


def canonical(form: NaturalForm, method: Method = "cholesky") -> CanonicalForm:
    """The canonical form of a policy given by its force: `a = M^-1 f`, arguments as `resolve`."""
    return CanonicalForm(resolve(form, method), form.M)


def resolve(form: NaturalForm, method: Method = "cholesky") -> jax.Array:
    """The acceleration that a policy in natural form asks for: `a = M^+ f`.

    **Arguments**: `form`, usually the root's; `method`:

    - `"cholesky"`, for run time: `M` symmetric and positive definite. Nothing is added to it: where it is singular
      the result is NaN or infinite, and the cure is a leaf that gives every direction some metric, such as a small
      `Damping`.
    - `"pinv"`, as in the paper: the pseudo-inverse, least acceleration where `M` is singular. Slower; it calls LAPACK.
    - `"lu"`, for the unsymmetric metrics of systems of more than one dimension whose metric depends on velocity.

    **Returns** the acceleration, the shape of `form.f`, units of x per second squared.
    **Raises** `UnknownNameError` for another method.

    >>> resolve(NaturalForm(jnp.array([2.0, 8.0]), jnp.diag(jnp.array([1.0, 4.0])))).tolist()
    [2.0, 2.0]

    RMPflow (Cheng et al. 2018), section 3.2.
    """
    if method == "cholesky":
        return _solve_by_cholesky(form.M, form.f)
    if method == "pinv":
        return einsum("...ij,...j->...i", jnp.linalg.pinv(form.M), form.f)
    if method == "lu":
        return lu_solve(form.M, form.f)
    raise UnknownNameError("method", method, get_args(Method))


@one_loop
def _solve_by_cholesky(M: jax.Array, f: jax.Array) -> jax.Array:
    return cholesky_solve(materialise(M), materialise(f))  # for where M is too large for a loop of scalars


def _refuse_other_space(form: Form, other: Form) -> None:
    if jnp.shape(form.f) != jnp.shape(other.f):
        raise ShapeError(
            f"forms of {jnp.shape(form.f)} and {jnp.shape(other.f)} do not live in the same space. Pull both back "
            "to a common space before you add them."
        )
