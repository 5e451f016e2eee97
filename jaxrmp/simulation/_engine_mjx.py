"""Many rollouts in MJX: policy and physics in one compiled program, on whatever devices there are."""

import contextlib
import io
import logging
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import importing
from ..scenes import Scene
from ..xla import WITHOUT_EMITTERS, known_options
from ._computed_torque import ArmDynamics, computed_torque, within_velocity_limits
from ._devices import Devices
from ._judge import End, Problem, StopCriteria, Track, judged
from ._step import command


def mjx_compiler_options() -> dict[str, bool]:
    """What `jax.jit(..., compiler_options=...)` needs for programs with MJX in them: nothing but on a CPU whose jaxlib
    is older than 0.11, where MJX without `xla_cpu_use_fusion_emitters=False` takes some 200 times as long."""
    return known_options(**WITHOUT_EMITTERS)


class MjxState(NamedTuple):
    """States of B starts: `q`, `qd` [B, n] of the arm, `qpos` [B, nq], `qvel` and `warm` [B, nv] (where the solver
    begins) of everything, and their `track`."""

    q: np.ndarray
    qd: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    warm: np.ndarray
    track: Track


class MjxEngine:
    """Computed torque within torque and velocity limits, in MJX; arguments as `MujocoEngine`.

    `devices`, by default all of this process. The model is part of the compiled program.

    **Raises** `MissingDependencyError` without mujoco-mjx.
    """

    name = "mjx"

    def __init__(
        self,
        scene: Scene,
        problem: Problem,
        criteria: StopCriteria,
        *,
        chunk: int = 250,
        every: int = 10,
        devices: Devices | None = None,
    ):
        self._mjx = import_mjx()
        self.scene, self.criteria, self.chunk, self.every = scene, criteria, chunk, every
        self.dt = float(scene.model.opt.timestep)
        self.devices = devices or Devices()
        self._problem = self.devices.copied(problem)
        self._model, first = self._mjx.put_model(scene.model), scene.fresh()
        self._qpos, self._of_arm = np.array(first.qpos), jnp.asarray(scene.of_arm)
        self._template = self._mjx.make_data(scene.model).replace(
            mocap_pos=jnp.asarray(first.mocap_pos, jnp.float32), mocap_quat=jnp.asarray(first.mocap_quat, jnp.float32)
        )
        every_one = self.devices.each(jax.vmap(self._chunk, in_axes=(None, 0)))
        self._advance = jax.jit(every_one, compiler_options=mjx_compiler_options())

    def begin(self, q: np.ndarray) -> MjxState:
        """States at rest at `q` [B, n]."""
        q = np.asarray(q, np.float32)
        qpos = np.repeat(np.asarray(self._qpos, np.float32)[None], len(q), axis=0)
        qpos[:, self.scene.arm_qpos] = q
        qvel = np.zeros((len(q), self.scene.model.nv), np.float32)
        return MjxState(q, np.zeros_like(q), qpos, qvel, qvel.copy(), Track.fresh(len(q)))

    def advance(self, state: MjxState) -> MjxState:
        """`chunk` steps of all in `state` that have not ended."""
        return jax.tree.map(np.asarray, self._advance(self._problem, self.devices.split(state)))

    def bytes_needed(self, batch: int) -> int:
        """Memory that one call with `batch` starts takes on each device."""
        split = self.devices.split(self.begin(np.zeros((batch, self.scene.robot.num_joints))))
        needed = self._advance.lower(self._problem, split).compile().memory_analysis()
        return 0 if needed is None else needed.temp_size_in_bytes + needed.output_size_in_bytes

    def _chunk(self, problem: Problem, state: MjxState) -> MjxState:
        def look(state, _):
            state, _ = jax.lax.scan(lambda s, _: (self._step(problem, s), None), state, length=self.every)
            clearance = jnp.minimum(state.track.clearance, problem.clearance(state.q))
            return state._replace(track=state.track._replace(clearance=clearance)), None

        with jax.default_matmul_precision("highest"):  # MJX leaves most products to the default
            return jax.lax.scan(look, state, length=self.chunk // self.every)[0]

    def _step(self, problem: Problem, state: MjxState) -> MjxState:
        mjx, model, scene = self._mjx, self._model, self.scene
        q, qd, track = state.q, state.qd, state.track
        asked = command(problem.tree, q, qd)
        track = judged(problem, self.criteria, self.dt, track, q, qd, asked)
        limits = scene.robot.velocity_limit, scene.torque_limit, scene.gear
        velocity_limit, torque_limit, gear = (jnp.asarray(a, q.dtype) for a in limits)
        qdd = within_velocity_limits(asked.qdd, qd, velocity_limit)
        data = self._template.replace(qpos=state.qpos, qvel=state.qvel, qacc_warmstart=state.warm)
        data = mjx.fwd_velocity(model, mjx.fwd_position(model, data))
        dofs = scene.arm_dofs
        bias = (data.qfrc_bias - data.qfrc_passive)[dofs]
        dynamics = ArmDynamics(mjx.full_m(model, data)[np.ix_(dofs, dofs)], bias)
        torque = computed_torque(dynamics, qdd, torque_limit).torque
        contact = getattr(data, "_impl", data).contact
        contacts = jnp.sum((contact.dist < 0) & self._of_arm[contact.geom].any(-1), dtype=jnp.int32)
        ahead = self._finish_step(data.replace(ctrl=data.ctrl.at[scene.arm_actuators].set(torque / gear)))
        running = track.status == End.RUNNING
        track = track._replace(
            touching=jnp.where(running, contacts, track.touching), touched=track.touched + (running & (contacts > 0))
        )
        new = (ahead.qpos[scene.arm_qpos], ahead.qvel[dofs], ahead.qpos, ahead.qvel, ahead.qacc_warmstart)
        q, qd, qpos, qvel, warm = (jnp.where(running, a, b) for a, b in zip(new, state[:-1], strict=True))
        return MjxState(q, qd, qpos, qvel, warm, track)

    def _finish_step(self, data: Any) -> Any:
        """What `mjx.step` does after `fwd_velocity`, for the implicitfast integrator."""
        mjx, model = self._mjx, self._model
        data = mjx.fwd_acceleration(model, mjx.fwd_actuation(model, data))
        constrained = getattr(data, "_impl", data).efc_J.size > 0
        data = mjx.solve(model, data) if constrained else data.replace(qacc=data.qacc_smooth)
        return mjx.implicit(model, data)


def import_mjx() -> Any:
    """`mujoco.mjx`, without what it prints where warp is not installed. **Raises** `MissingDependencyError`."""
    level = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        void = io.StringIO()
        with importing("mujoco-mjx", "simulation"), contextlib.redirect_stdout(void), contextlib.redirect_stderr(void):
            from mujoco import mjx
    finally:
        logging.disable(level)
    return mjx
