"""Whether a rollout ended at its goals."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np

from .._pytree import pytree, static
from ._rollout import Rollout


class GoalWarning(UserWarning):
    """A rollout came to rest away from a goal."""


@pytree
class Arrival:
    """How a rollout ended.

    `gap` [G], the distance left to each goal, in units of the leaf's space; `reached` [G], whether that is within the
    tolerance; `at_rest`, whether the joints had stopped; `out_of_reach` [G], at rest away from the goal: more time will
    not help; `goals`, the names of the leaves.
    """

    gap: jax.Array
    reached: jax.Array
    at_rest: jax.Array
    goals: tuple[str, ...] = static()

    @property
    def out_of_reach(self) -> jax.Array:
        """Which goals the arm rests away from, [G]."""
        return ~self.reached & self.at_rest[..., None]


def arrival(path: Rollout, tolerance: jax.Array | float = 0.01, rest_speed: jax.Array | float = 0.01) -> Arrival:
    """Say whether a rollout ended at its goals, and if not, whether the arm has come to rest away from them.

    A goal out of reach, behind an obstacle or against a joint limit, or two goals that cannot both be had, is no error
    of the policy: it balances them. This is where that shows.

    **Arguments**: `path`, of one rollout (for many, `vmap`); `tolerance`, the gap that counts as reached, one for all
    goals or [G], units of each leaf's space; `rest_speed`, rad/s or m/s: the arm is at rest if over the last tenth of
    the rollout no joint is faster, nor would become faster within a second at its mean acceleration.
    **Returns** an `Arrival`.

    >>> from jaxrmp.leaves import Attractor
    >>> from jaxrmp.simulation import rollout
    >>> found = arrival(rollout(Attractor(jnp.ones(2), sharpness=4.0), jnp.zeros(2), duration=20.0, dt=0.02))
    >>> found.goals, found.reached.tolist(), bool(found.at_rest)
    (('attractor',), [True], True)
    """
    steps = len(path.time) - 1
    first = steps - max(1, steps // 10)
    speed = jnp.max(jnp.abs(path.qd[first:]))
    growth = jnp.max(jnp.abs(path.qd[-1] - path.qd[first])) / (path.time[-1] - path.time[first])
    at_rest = jnp.maximum(speed, growth) <= rest_speed  # false for NaN
    return Arrival(path.gap[-1], path.gap[-1] <= tolerance, at_rest, path.goals)


def warn_if_out_of_reach(path: Rollout, stacklevel: int = 2) -> Arrival:
    """Issue a `GoalWarning` that names the goals that the arm came to rest away from on `path`; not under `jax.jit`.

    `stacklevel` is `warnings.warn`'s. **Returns** what `arrival` does.
    """
    found = arrival(path)
    missed = np.flatnonzero(found.out_of_reach)
    if missed.size:
        left = ", ".join(f"{float(found.gap[i]):.3g} from that of {found.goals[i]!r}" for i in missed)
        warnings.warn(
            f"the arm came to rest away from its goals: {left} (units of each leaf's space). They are out of reach, or "
            "other leaves hold the arm off: inspection.inspect(tree, path.q[-1], path.qd[-1]) shows which.",
            GoalWarning,
            stacklevel=stacklevel,
        )
    return found
