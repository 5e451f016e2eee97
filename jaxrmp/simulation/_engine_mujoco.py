"""Many rollouts in native MuJoCo, judged by the skill's own goal."""

from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np

from ..kinematics._mujoco import import_mujoco
from ..scenes import Scene
from ._devices import Devices
from ._judge import Problem, StopCriteria, Track, clearances, judged
from ._physical_arm import PhysicalArm, step_all
from ._step import command


class MujocoState(NamedTuple):
    """States of B starts: `q`, `qd` [B, n] of the arm, `full` [B, m], MuJoCo's own of everything, and their `track`."""

    q: np.ndarray
    qd: np.ndarray
    full: np.ndarray
    track: Track


class MujocoEngine:
    """Computed torque within torque and velocity limits, in MuJoCo on the CPU; arguments as of `KinematicEngine`.

    `scene`, whose model's time step is the engine's; what the arm touches there does not end a rollout.
    """

    name = "mujoco"

    def __init__(self, scene: Scene, problem: Problem, criteria: StopCriteria, *, chunk: int = 250, every: int = 10):
        self._mujoco = import_mujoco()
        self.scene, self.criteria, self.chunk, self.every = scene, criteria, chunk, every
        self.dt = float(scene.model.opt.timestep)
        self.devices = Devices(jax.local_devices()[:1])
        self._problem = self.devices.copied(problem)
        self._arms: list[PhysicalArm] = []
        self._kind = self._mujoco.mjtState.mjSTATE_INTEGRATION

    def begin(self, q: np.ndarray) -> MujocoState:
        """States at rest at `q` [B, n]."""
        q = np.asarray(q, np.float32)
        data, model = self.scene.fresh(), self.scene.model
        full = np.empty((len(q), self._mujoco.mj_stateSize(model, self._kind)))
        for row, start in zip(full, q, strict=True):
            data.qpos[self.scene.arm_qpos] = start
            self._mujoco.mj_getState(model, data, row, self._kind)
        return MujocoState(q, np.zeros_like(q), full, Track.fresh(len(q)))

    def advance(self, state: MujocoState) -> MujocoState:
        """`chunk` steps of all in `state` that have not ended."""
        mujoco, model = self._mujoco, self.scene.model
        self._grow(len(state.q))
        arms = self._arms[: len(state.q)]
        for arm, row in zip(arms, state.full, strict=True):
            mujoco.mj_setState(model, arm.data, row, self._kind)
        q, qd, full = state.q.copy(), state.qd.copy(), state.full.copy()
        track = jax.tree.map(np.array, state.track)
        for step in range(self.chunk):
            track = step_all(arms, track, q, qd, self._command)
            if step % self.every == self.every - 1:
                track = track._replace(clearance=np.fmin(track.clearance, clearances(self._problem, q)))
        for arm, row in zip(arms, full, strict=True):
            mujoco.mj_getState(model, arm.data, row, self._kind)
        return MujocoState(q, qd, full, track)

    def bytes_needed(self, batch: int) -> int:
        """Memory that `batch` starts take."""
        self._grow(1)
        return batch * int(self._arms[0].data.nbuffer + self.scene.model.narena)

    def _grow(self, count: int) -> None:
        self._arms += [PhysicalArm(self.scene, self.scene.fresh()) for _ in range(count - len(self._arms))]

    def _command(self, track: Track, q: np.ndarray, qd: np.ndarray) -> tuple[Any, Track]:
        return _judge_and_command(self._problem, self.criteria, self.dt, track, q, qd)


@jax.jit
@partial(jax.vmap, in_axes=(None, None, None, 0, 0, 0))
def _judge_and_command(problem: Problem, criteria: StopCriteria, dt: float, track: Track, q: jax.Array, qd: jax.Array):
    asked = command(problem.tree, q, qd)
    return asked.qdd, judged(problem, criteria, dt, track, q, qd, asked)
