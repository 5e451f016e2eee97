"""Task maps: how coordinates of one space become coordinates of another.

A task map is any function `y = psi(x)`. Its pushforward carries a state along: position, velocity, Jacobian and
the curvature term `c = Jdot xd`, all in one pass. Autodiff gives it for every function; a map that knows a faster
way subclasses `TaskMap` and overrides `pushforward`. Policies come the other way: `transport` gives the state there
with the function that pulls a form back, as `jax.vjp` does for gradients. By default that function is made of J and
c; a map that can do without them, since it knows what they are made of, overrides `transport` too.

Shapes. A space of K points of dimension m has coordinates [K, m]. From a vector [n], the Jacobian is [K, m, n]
(or [m, n] for one point). A map that takes points to points one by one has the block-diagonal Jacobian [K, m', m].
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from ._errors import RigidTransformError, ShapeError
from ._forms import DiagonalForm, Form, NaturalForm
from ._linalg import einsum, length, matmul
from ._pytree import as_pytree, pytree, set_field, static
from ._ranges import NonNegative


class Pushforward(NamedTuple):
    """A state carried through a task map: `y = psi(x)`, `yd = J xd`, `J = d psi/dx`, `c = Jdot xd`."""

    y: jax.Array
    yd: jax.Array
    J: jax.Array
    c: jax.Array


class Transport(NamedTuple):
    """A state carried through a task map, `y = psi(x)`, `yd = J xd`, and the way back for forms.

    `pull` takes `[f, M]` on y to `[J^T (f - M c), J^T M J]` on x.
    """

    y: jax.Array
    yd: jax.Array
    pull: Callable[[Form], Form]


class TaskMap:
    """A differentiable map between task spaces.

    Subclasses give `__call__` and may give a faster `pushforward` or `transport`, equal to these to rounding.
    """

    def __call__(self, x: jax.Array) -> jax.Array:
        raise NotImplementedError

    def pushforward(self, x: jax.Array, xd: jax.Array) -> Pushforward:
        """The state `x, xd` [m] carried through this map; as the function `pushforward`."""
        return pushforward_by_autodiff(self, x, xd)

    def transport(self, x: jax.Array, xd: jax.Array) -> Transport:
        """The state `x, xd` [m] carried through this map, with the way back; as the function `transport`."""
        return transport_by_jacobian(self, x, xd)


def pushforward(task_map: Callable[[jax.Array], jax.Array], x: jax.Array, xd: jax.Array) -> Pushforward:
    """Carry the state `(x, xd)` through `task_map`.

    **Arguments**: `task_map`, a `TaskMap` or any differentiable function; `x`, coordinates; `xd`, units of x per
    second, same shape as `x`.
    **Returns** `(y, yd, J, c)` with `c = Jdot xd`, so that `ydd = J xdd + c`.
    **Raises** `ShapeError` if a plain function is given coordinates of more than one axis: wrap it in `Pointwise`.

    >>> carried = pushforward(lambda x: x**2, jnp.array([3.0]), jnp.array([1.0]))
    >>> carried.yd.tolist(), carried.c.tolist()
    ([6.0], [2.0])

    RMPflow (Cheng et al. 2018), section 3.2.
    """
    if isinstance(task_map, TaskMap):
        return task_map.pushforward(x, xd)
    return pushforward_by_autodiff(task_map, x, xd)


def pushforward_by_autodiff(psi: Callable[[jax.Array], jax.Array], x: jax.Array, xd: jax.Array) -> Pushforward:
    """The pushforward of any differentiable function of one vector [n], by forward-mode autodiff."""
    if x.ndim != 1:
        raise ShapeError(f"x has shape {x.shape}, expected one axis. To map K points one by one, use Pointwise(psi).")

    def velocity(x):
        return jax.jvp(psi, (x,), (xd,))

    (y, yd), (_, c) = jax.jvp(velocity, (x,), (xd,))
    return Pushforward(y, yd, jax.jacfwd(psi)(x), c)


def transport(task_map: Callable[[jax.Array], jax.Array], x: jax.Array, xd: jax.Array) -> Transport:
    """Carry the state `(x, xd)` through `task_map`, with the function that pulls forms back; see `Transport`.

    **Arguments** and **raises** as `pushforward`.

    >>> there = transport(lambda x: 3.0 * x, jnp.ones(1), jnp.ones(1))
    >>> there.yd.tolist(), there.pull(NaturalForm(jnp.ones(1), jnp.eye(1))).M.tolist()
    ([3.0], [[9.0]])

    Rana et al. 2019, equation 9.
    """
    if isinstance(task_map, TaskMap):
        return task_map.transport(x, xd)
    return transport_by_jacobian(task_map, x, xd)


def transport_by_jacobian(task_map: Callable[[jax.Array], jax.Array], x: jax.Array, xd: jax.Array) -> Transport:
    """The transport of any task map, by its pushforward."""
    there = pushforward(task_map, x, xd)
    return Transport(there.y, there.yd, lambda form: pull_form(there, form, x.ndim))


def pull_form(there: Pushforward, form: Form, domain_axes: int) -> NaturalForm:
    """Pull a form on y back through a pushforward; points of y are summed up if the domain is one vector."""
    J = there.J
    if isinstance(form, DiagonalForm):
        f, MJ = form.f - form.d * there.c, form.d[..., None] * J
    else:
        f, MJ = form.f - einsum("...ij,...j->...i", form.M, there.c), matmul(form.M, J)
    if domain_axes == 1:
        f, J, MJ = f.reshape(-1), J.reshape(-1, J.shape[-1]), MJ.reshape(-1, J.shape[-1])
        return NaturalForm(matmul(f, J), matmul(J.T, MJ))
    return NaturalForm(einsum("...ij,...i->...j", J, f), matmul(jnp.swapaxes(J, -1, -2), MJ))


@pytree
class Identity(TaskMap):
    """`y = x`.

    >>> Identity()(jnp.ones(2)).tolist()
    [1.0, 1.0]
    """

    def __call__(self, x):
        return x

    def pushforward(self, x, xd):
        eye = jnp.eye(x.shape[-1], dtype=x.dtype)
        return Pushforward(self(x), xd, jnp.broadcast_to(eye, (*x.shape, x.shape[-1])), jnp.zeros_like(x))

    def transport(self, x, xd):
        return Transport(self(x), xd, lambda form: form)


@pytree
class Selection(TaskMap):
    """`y = x[indices]`: the coordinates `indices` of a vector, in the order given.

    >>> Selection((2, 0))(jnp.array([1.0, 2.0, 3.0])).tolist()
    [3.0, 1.0]
    """

    indices: tuple[int, ...] = static()

    def __post_init__(self):
        set_field(self, "indices", tuple(int(i) for i in self.indices))

    def __call__(self, x):
        return x[self._rows(x)]

    def _rows(self, x):
        rows = np.asarray(self.indices, int)
        if x.ndim != 1 or (rows.size and not (-len(x) <= rows.min() and rows.max() < len(x))):
            raise ShapeError(f"indices {self.indices} do not fit coordinates of shape {x.shape}.")
        return rows

    def pushforward(self, x, xd):
        rows = self._rows(x)
        J = jnp.eye(x.shape[0], dtype=x.dtype)[rows]
        return Pushforward(x[rows], xd[rows], J, jnp.zeros(rows.shape, x.dtype))


@pytree
class Affine(TaskMap):
    """`y = A x + b`, with `A` [m, n] and `b` [m].

    >>> Affine(A=jnp.array([[2.0, 1.0]]), b=jnp.array([0.5]))(jnp.ones(2)).tolist()
    [3.5]
    """

    A: jax.Array
    b: jax.Array

    def __call__(self, x):
        return matmul(jnp.asarray(self.A, x.dtype), x) + jnp.asarray(self.b, x.dtype)

    def pushforward(self, x, xd):
        A = jnp.asarray(self.A, x.dtype)
        return Pushforward(self(x), matmul(A, xd), A, jnp.zeros(A.shape[:1], x.dtype))


@pytree
class RigidTransform(TaskMap):
    """World points seen from a frame: `y = R^T (p - t)`, for one point [3] or K points [K, 3].

    `T_world_frame` [4, 4] is the frame's pose, a parameter: a tracked object moves without recompilation. Within
    one evaluation the frame stands still, as in the paper; the certificate speaks of that frozen frame.

    **Raises** `RigidTransformError` when built from numbers that are not a rigid transform.

    >>> T = jnp.eye(4).at[:3, 3].set(jnp.array([1.0, 0.0, 0.0]))
    >>> RigidTransform(T)(jnp.array([3.0, 2.0, 1.0])).tolist()
    [2.0, 2.0, 1.0]
    """

    T_world_frame: jax.Array

    def __post_init__(self):
        concrete = not isinstance(self.T_world_frame, Tracer)
        if concrete and check_rigid(self.T_world_frame, "T_world_frame").ndim != 2:
            raise RigidTransformError(
                f"T_world_frame has shape {np.shape(self.T_world_frame)}, expected (4, 4). For many frames, vmap."
            )
        set_field(self, "T_world_frame", jnp.asarray(self.T_world_frame))

    def __call__(self, x):
        R, t = self._rotation_and_origin(x.dtype)
        return matmul(x - t, R)

    def pushforward(self, x, xd):
        R, t = self._rotation_and_origin(x.dtype)
        J = jnp.broadcast_to(R.T, (*x.shape[:-1], 3, 3))
        return Pushforward(matmul(x - t, R), matmul(xd, R), J, jnp.zeros_like(x))

    def transport(self, x, xd):
        R, t = self._rotation_and_origin(x.dtype)

        def pull(form):
            form = form.dense()
            return NaturalForm(matmul(form.f, R.T), einsum("ai,...ij,bj->...ab", R, form.M, R))

        return Transport(matmul(x - t, R), matmul(xd, R), pull)

    def _rotation_and_origin(self, dtype):
        T = jnp.asarray(self.T_world_frame, dtype)
        return T[:3, :3], T[:3, 3]


@pytree
class Translation(Identity):
    """`y = x - origin`: moves `origin` (shape of x) to zero. Used to put a subtask's target at the origin.

    >>> Translation(jnp.array([1.0, 2.0]))(jnp.array([1.0, 3.0])).tolist()
    [0.0, 1.0]
    """

    origin: jax.Array

    def __call__(self, x):
        return x - jnp.asarray(self.origin, x.dtype)


@pytree
class Distance(TaskMap):
    """Signed distance [1] of a point to a sphere: `y = |x - center| - radius`, in metres.

    At the centre itself, where the direction is undefined, the Jacobian is zero rather than NaN.

    **Arguments**: `center` [m]; `radius`, m.
    **Raises** `ConfigurationError` for a negative radius.

    >>> Distance(jnp.array([3.0, 4.0]), 1.0)(jnp.zeros(2)).tolist()
    [4.0]
    """

    center: jax.Array
    radius: NonNegative[jax.Array | float] = 0.0

    def __call__(self, x):
        return (length(x - jnp.asarray(self.center, x.dtype)) - self.radius)[None].astype(x.dtype)


@pytree
class Composition(TaskMap):
    """`y = maps[-1](... maps[0](x))`: the first of `maps` is applied first."""

    maps: tuple[Callable, ...]

    def __call__(self, x):
        for psi in self.maps:
            x = psi(x)
        return x

    def pushforward(self, x, xd):
        total = pushforward(self.maps[0], x, xd)
        for psi in self.maps[1:]:
            step = pushforward(psi, total.y, total.yd)
            c = step.c + einsum("...ij,...j->...i", step.J, total.c)
            total = Pushforward(step.y, step.yd, matmul(step.J, total.J), c)
        return total

    def transport(self, x, xd):
        steps = []
        for psi in self.maps:
            x, xd, pull = transport(psi, x, xd)
            steps.append(pull)

        def pull_through(form):
            for pull in reversed(steps):
                form = pull(form)
            return form

        return Transport(x, xd, pull_through)


@pytree
class Stack(TaskMap):
    """The coordinates of `maps` of the same vector, one after the other: `y = [psi_1(x), psi_2(x), ...]`."""

    maps: tuple[Callable, ...]

    def __call__(self, x):
        return jnp.concatenate([psi(x) for psi in self.maps])

    def pushforward(self, x, xd):
        parts = [pushforward(psi, x, xd) for psi in self.maps]
        return Pushforward(*(jnp.concatenate(column) for column in zip(*parts, strict=True)))


@pytree
class Pointwise(TaskMap):
    """`task_map`, a map of one point, applied to each of K points [K, m] alike.

    >>> Pointwise(Distance(jnp.zeros(2)))(jnp.array([[3.0, 4.0], [0.0, 2.0]])).tolist()
    [[5.0], [2.0]]
    """

    task_map: Callable

    def __post_init__(self):
        set_field(self, "task_map", as_pytree(self.task_map))

    def __call__(self, x):
        return jax.vmap(self.task_map)(x)

    def pushforward(self, x, xd):
        return jax.vmap(lambda x, xd: pushforward(self.task_map, x, xd))(x, xd)


def compose(*maps: Callable) -> TaskMap:
    """Task maps `*maps` one after the other, the first applied first: `compose(f, g)(x) = g(f(x))`.

    >>> compose(Selection((0, 1)), Distance(jnp.zeros(2)))(jnp.array([3.0, 4.0, 9.0])).tolist()
    [5.0]
    """
    if not maps:
        return Identity()
    return maps[0] if len(maps) == 1 and isinstance(maps[0], TaskMap) else Composition(tuple(map(as_pytree, maps)))


def stack(*maps: Callable) -> Stack:
    """Task maps `*maps` of the same coordinates side by side.

    >>> stack(Selection((0,)), Distance(jnp.zeros(2)))(jnp.array([3.0, 4.0])).tolist()
    [3.0, 5.0]
    """
    return Stack(tuple(map(as_pytree, maps)))


def check_rigid(T, name: str = "pose", tolerance: float = 1e-4) -> np.ndarray:
    """Return `T` [..., 4, 4] as NumPy if every matrix in it is a rigid transform.

    **Raises** `RigidTransformError` that says which condition fails: shape, finiteness, last row, orthonormality,
    or handedness. `tolerance` is on the entries of `R^T R - I` and of the last row.
    """
    T = np.asarray(T)
    if T.shape[-2:] != (4, 4):
        raise RigidTransformError(f"{name} has shape {T.shape}, expected [..., 4, 4].")
    if not np.isfinite(T).all():
        raise RigidTransformError(f"{name} holds non-finite numbers.")
    R = T[..., :3, :3]
    if np.abs(T[..., 3, :] - [0, 0, 0, 1]).max() > tolerance:
        raise RigidTransformError(f"{name} has last row {T.reshape(-1, 4, 4)[0, 3].tolist()}, expected [0, 0, 0, 1].")
    error = np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3)).max()
    if error > tolerance:
        raise RigidTransformError(
            f"{name} is no rigid transform: its rotation part is not orthonormal (largest entry of R^T R - I is "
            f"{error:.2e}, allowed {tolerance:.0e})."
        )
    if np.linalg.det(R).min() < 0:
        raise RigidTransformError(f"{name} is no rigid transform: its rotation part is a reflection (det R = -1).")
    return T
