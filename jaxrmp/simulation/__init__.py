"""Rolling policies out."""

from ._computed_torque import ArmDynamics as ArmDynamics
from ._computed_torque import Torque as Torque
from ._computed_torque import arm_dynamics as arm_dynamics
from ._computed_torque import computed_torque as computed_torque
from ._computed_torque import tracking_acceleration as tracking_acceleration
from ._computed_torque import within_velocity_limits as within_velocity_limits
from ._kinematic import Rollout as Rollout
from ._kinematic import rollout as rollout
from ._stable_step import StiffnessWarning as StiffnessWarning
from ._stable_step import stable_step as stable_step
from ._stable_step import warn_if_stiff as warn_if_stiff
