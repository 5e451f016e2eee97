"""Many rollouts in native MuJoCo: one compiled call of the policy a millisecond, then a step of each model."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._tree import acceleration
from ..kinematics._mujoco import import_mujoco
from ._computed_torque import within_velocity_limits
from ._devices import Devices
from ._judge import Problem, Status, StopCriteria, Track, judge
from ._physical_arm import PhysicalArm


class MujocoState(NamedTuple):
    """States of B starts: `q`, `qd` [B, n] of the arm, `full` [B, m], MuJoCo's own of everything, and their `track`."""

    q: np.ndarray
    qd: np.ndarray
    full: np.ndarray
    track: Track


class MujocoEngine:
    """Computed torque within torque and velocity limits, in MuJoCo on the CPU; arguments as of `KinematicEngine`.

    `arm`, in its model, whose time step is the engine's.
    """

    name = "mujoco"

    def __init__(
        self, arm: PhysicalArm, problem: Problem, criteria: StopCriteria, *, chunk: int = 250, every: int = 10
    ):
        self._mujoco = import_mujoco()
        self.arm, self.criteria, self.chunk, self.every = arm, criteria, chunk, every
        self.dt = float(arm.model.opt.timestep)
        self.devices = Devices(jax.local_devices()[:1])
        self._problem = self.devices.copied(problem)
        self._data: list[Any] = []
        self._kind = self._mujoco.mjtState.mjSTATE_INTEGRATION

    def begin(self, q: np.ndarray) -> MujocoState:
        """States at rest at `q` [B, n]."""
        q = np.asarray(q, np.float32)
        data = self.arm.data()
        full = np.empty((len(q), self._mujoco.mj_stateSize(self.arm.model, self._kind)))
        for row, start in zip(full, q, strict=True):
            data.qpos[self.arm.positions] = start
            self._mujoco.mj_getState(self.arm.model, data, row, self._kind)
        return MujocoState(q, np.zeros_like(q), full, Track.fresh(len(q)))

    def advance(self, state: MujocoState) -> MujocoState:
        """`chunk` steps of all that have not ended."""
        mujoco, arm = self._mujoco, self.arm
        model, B = arm.model, len(state.q)
        self._data += [arm.data() for _ in range(B - len(self._data))]
        for data, full in zip(self._data, state.full, strict=False):
            mujoco.mj_setState(model, data, full, self._kind)
        q, qd, full = state.q.copy(), state.qd.copy(), state.full.copy()
        track = jax.tree.map(np.array, state.track)
        wanted, torque = np.zeros(model.nv), np.zeros(model.nv)
        for step in range(self.chunk):
            qdd, seen = _judge_and_command(self._problem, self.criteria, self.dt, track, q, qd)
            track = jax.tree.map(np.array, seen)
            running = np.flatnonzero(track.status == Status.RUNNING)
            qdd = within_velocity_limits(np.asarray(qdd, float), qd, arm.velocity_limit)
            for i in running:
                data = self._data[i]
                mujoco.mj_step1(model, data)
                wanted[arm.velocities] = qdd[i]
                mujoco.mj_mulM(model, data, torque, wanted)
                torque += data.qfrc_bias - data.qfrc_passive
                data.ctrl[arm.actuators] = np.clip(torque[arm.velocities], -arm.torque_limit, arm.torque_limit)
                track.touching[i] = data.ncon
                track.touched[i] += data.ncon > 0
                mujoco.mj_step2(model, data)
                q[i], qd[i] = data.qpos[arm.positions], data.qvel[arm.velocities]
            if step % self.every == self.every - 1:
                track = track._replace(clearance=np.fmin(track.clearance, _clearances(self._problem, q)))
        for data, row in zip(self._data, full, strict=False):
            mujoco.mj_getState(model, data, row, self._kind)
        return MujocoState(q, qd, full, track)

    def bytes_needed(self, batch: int) -> int:
        """Memory that `batch` starts take."""
        return batch * int(self._data_of_one().nbuffer + self.arm.model.narena)

    def _data_of_one(self) -> Any:
        if not self._data:
            self._data.append(self.arm.data())
        return self._data[0]


@jax.jit
def _judge_and_command(problem: Problem, criteria: StopCriteria, dt: float, track: Track, q: jax.Array, qd: jax.Array):
    def one(track, q, qd):
        track = judge(problem, criteria, dt, track, q, qd, problem.tree.energy(q, qd))
        return acceleration(problem.tree, q, qd), track

    return jax.vmap(one)(track, jnp.asarray(q), jnp.asarray(qd))


@jax.jit
def _clearances(problem: Problem, q: jax.Array) -> jax.Array:
    return jax.vmap(problem.clearance)(jnp.asarray(q))
