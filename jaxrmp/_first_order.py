"""The first-order form of a tree, for arms that are driven by velocity."""

import jax
import jax.numpy as jnp

from ._certificate import uncertified_leaves
from ._errors import ConfigurationError
from ._forms import Method, NaturalForm, resolve
from ._tree import Node


def velocity(tree: Node, q: jax.Array, method: Method = "cholesky", time_scale: jax.Array | float = 1.0) -> jax.Array:
    """The joint velocity of natural gradient descent: `qd = time_scale M^+ p` with the momentum `p = -grad Phi`.

    Each leaf contributes the momentum `-grad Phi` and its metric at rest, pulled back as forces are: the root has
    `p = -d/dq V(q, 0)`, V the energy of the tree, and `M = M(q, 0)`. At rest a geometric dynamical system has no other
    force, so this is the acceleration from rest times `time_scale`, seconds. Along it the potential falls:
    `dPhi/dt = -time_scale p^T M^+ p`.

    If every leaf has `B = gamma M`, then `time_scale = 1 / gamma` gives `-B^-1 grad Phi`: the velocity to which the
    second-order policy settles as gamma grows. For leaves of unequal damping rates that is `overdamped_velocity`. A
    `Learned` leaf alone moves at `speed` times its learned field `-M^-1 grad Phi` for `time_scale = 1 / damping_rate`.

    **Arguments**: `tree`, a node on joint space; `q` [n], rad or m; `method`, see `resolve`; `time_scale`, s.
    **Returns** `qd` [n], per second. Euler steps are stable below `2 / (time_scale lambda)`, lambda the largest
    eigenvalue of `M^-1 Hess Phi` at the root.
    **Raises** `ConfigurationError` naming the leaves that have no potential.

    >>> from jaxrmp.leaves import Posture
    >>> velocity(Posture(jnp.ones(2), weight=1.0, stiffness=4.0), jnp.zeros(2), time_scale=0.5).tolist()
    [2.0, 2.0]

    RMPflow (Cheng et al. 2018), section 4; Rana et al. 2019, section 3, for the field.
    """
    _check_potentials(tree)
    return jnp.asarray(time_scale, q.dtype) * resolve(tree(q, jnp.zeros_like(q)), method)


def overdamped_velocity(tree: Node, q: jax.Array, method: Method = "cholesky") -> jax.Array:
    """The velocity at which damping balances the potential: `qd = B^+ p` with `p = -grad Phi`.

    The quasi-static limit of the second-order policy, in its own units and without a time scale: `B` is the root
    damping at rest, half the Hessian of the tree's dissipation in qd. Directions that no leaf damps have none, so give
    every joint some. The potential falls along it at the rate of the dissipation.

    **Arguments**, **returns** and **raises** as `velocity`.

    >>> from jaxrmp.leaves import Posture
    >>> overdamped_velocity(Posture(jnp.ones(2), weight=1.0, stiffness=4.0, damping_rate=2.0), jnp.zeros(2)).tolist()
    [2.0, 2.0]
    """
    _check_potentials(tree)
    rest = jnp.zeros_like(q)
    B = 0.5 * jax.jacfwd(jax.grad(tree.dissipation, argnums=1), argnums=1)(q, rest)
    return resolve(NaturalForm(tree(q, rest).f, 0.5 * (B + B.T)), method)


def _check_potentials(tree: Node) -> None:
    if names := uncertified_leaves(tree):
        raise ConfigurationError(
            f"leaves {list(names)} have no potential, so the tree has no first-order form. Leave them out of the tree, "
            "or use geometric dynamical systems in their place; acceleration(tree, q, qd) drives any tree."
        )
