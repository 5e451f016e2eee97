"""From the accelerations that a policy asks for to joint torques, within an arm's limits.

Plain arithmetic on arrays of NumPy or of JAX, so that one controller runs in MuJoCo, in MJX and on an arm.
"""

from typing import Any, NamedTuple

import numpy as np

from ..kinematics._mujoco import import_mujoco


class Torque(NamedTuple):
    """`torque` [n], N m (or N), within its limits; `saturated` [n], whether a limit cut it."""

    torque: Any
    saturated: Any


class ArmDynamics(NamedTuple):
    """An arm's dynamics at a state.

    `mass_matrix` [n, n], kg m^2; `bias` [n], gravity, Coriolis and centrifugal torques less those of springs and
    dampers, N m.
    """

    mass_matrix: Any
    bias: Any


def computed_torque(dynamics: ArmDynamics, qdd: Any, limit: Any) -> Torque:
    """Torques that give an arm free of contact the acceleration `qdd`: `tau = M(q) qdd + h(q, qd)`, cut at `limit`.

    **Arguments**: `dynamics`, at the present state; `qdd` [n], rad/s^2; `limit` [n], the largest torque, N m.
    **Returns** a `Torque`.

    Siciliano et al., Robotics: Modelling, Planning and Control, section 8.5.2.
    """
    wanted = (dynamics.mass_matrix * qdd).sum(-1) + dynamics.bias
    torque = wanted.clip(-limit, limit)
    return Torque(torque, torque != wanted)


def tracking_acceleration(qdd: Any, position_error: Any, velocity_error: Any, stiffness: float, damping: float) -> Any:
    """What a position or velocity interface asks of its torque loop: `qdd + kp (q_ref - q) + kd (qd_ref - qd)`.

    **Arguments**: `qdd` [n], of the reference; `position_error`, `velocity_error` [n], reference less measured;
    `stiffness` kp, 1/s^2, `damping` kd, 1/s.
    """
    return qdd + stiffness * position_error + damping * velocity_error


def within_velocity_limits(qdd: Any, qd: Any, limit: Any, horizon: float = 0.01) -> Any:
    """`qdd` [n] cut so that velocity `qd` [n], kept up for `horizon` seconds, stays within `limit` [n], rad/s.

    A joint beyond its limit is braked back to it within `horizon`.
    """
    return qdd.clip((-limit - qd) / horizon, (limit - qd) / horizon)


def arm_dynamics(model: Any, data: Any, dofs: np.ndarray) -> ArmDynamics:
    """The dynamics of the joints `dofs` [n], by MuJoCo's own `model`, after `mj_step1` or `mj_forward` on `data`.

    The other joints count as free to move on their own: right for an arm that stands apart from the furniture.
    """
    mujoco = import_mujoco()
    M = np.empty((model.nv, model.nv))
    if hasattr(data, "qM"):  # MuJoCo before 3.4
        mujoco.mj_fullM(model, M, data.qM)
    else:
        mujoco.mj_fullM(model, data, M)
    return ArmDynamics(M[np.ix_(dofs, dofs)], data.qfrc_bias[dofs] - data.qfrc_passive[dofs])
