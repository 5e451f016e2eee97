"""Many kinematic rollouts at once: joints that do exactly what the policy asks, one compiled program a chunk."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..xla import in_lanes
from ._devices import Devices
from ._judge import End, Problem, StopCriteria, Track, judged
from ._step import Motion, command, euler


class KinematicState(NamedTuple):
    """States of B starts: `q` [B, n] and `rest`, what rounding cut off it, `qd` [B, n], and their `track`."""

    q: np.ndarray
    rest: np.ndarray
    qd: np.ndarray
    track: Track


class KinematicEngine:
    """Semi-implicit Euler, `qd += dt qdd; q += dt qd`, on the devices of this process.

    **Arguments**: `problem`; `criteria`; `dt`, seconds; `chunk`, steps of one call; `every`, steps from one look at
    the clearance to the next, a divisor of `chunk`; `devices`, by default all of this process.
    """

    name = "kinematic"

    def __init__(
        self,
        problem: Problem,
        criteria: StopCriteria,
        *,
        dt: float = 0.001,
        chunk: int = 250,
        every: int = 10,
        devices: Devices | None = None,
    ):
        self.criteria, self.dt, self.chunk, self.every = criteria, dt, chunk, every
        self.devices = devices or Devices()
        self._problem = self.devices.copied(problem)

    def begin(self, q: np.ndarray) -> KinematicState:
        """States at rest at `q` [B, n]."""
        q = np.asarray(q, np.float32)
        return KinematicState(q, np.zeros_like(q), np.zeros_like(q), Track.fresh(len(q)))

    def advance(self, state: KinematicState) -> KinematicState:
        """`chunk` steps of all in `state` that have not ended."""
        state = _advance(self._problem, self.devices.split(state), self.criteria, self.dt, **self._settings())
        return jax.tree.map(np.asarray, state)

    def bytes_needed(self, batch: int) -> int:
        """Memory that one call with `batch` starts takes on each device, beside the problem's own."""
        split = self.devices.split(self.begin(np.zeros((batch, self._problem.lower.shape[0]))))
        lowered = _advance.lower(self._problem, split, self.criteria, self.dt, **self._settings())
        needed = lowered.compile().memory_analysis()
        return 0 if needed is None else needed.temp_size_in_bytes + needed.output_size_in_bytes

    def _settings(self):
        return {"chunk": self.chunk, "every": self.every, "devices": self.devices}


@partial(jax.jit, static_argnames=("chunk", "every", "devices"))
def _advance(
    problem: Problem, state: KinematicState, criteria: StopCriteria, dt: float, chunk: int, every: int, devices: Devices
):
    def of_one(problem, criteria, dt, state):
        def step(state, _):
            return _stepped(problem, criteria, dt, state), None

        def look(state, _):
            state, _ = jax.lax.scan(step, state, length=every)
            clearance = jnp.minimum(state.track.clearance, problem.clearance(state.q))
            return state._replace(track=state.track._replace(clearance=clearance)), None

        return jax.lax.scan(look, state, length=chunk // every)[0]

    return devices.each(jax.vmap(of_one, in_axes=(None, None, None, 0)))(problem, criteria, dt, state)


@in_lanes
def _stepped(problem: Problem, criteria: StopCriteria, dt: jax.Array, state: KinematicState) -> KinematicState:
    """One start a step on, unless it has ended."""
    q, rest, qd, track = state
    asked = command(problem.tree, q, qd)
    track = judged(problem, criteria, dt, track, q, qd, asked)
    running, now = track.status == End.RUNNING, Motion(q, rest, qd)
    ahead = euler(now, asked.qdd, dt)
    return KinematicState(*jax.tree.map(partial(jnp.where, running), ahead, now), track=track)
