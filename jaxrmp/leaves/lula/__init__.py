"""The leaves of NVIDIA's Lula and cuMotion, with the names and defaults of their `rmp_params` for the Franka.

Accelerations with hand-made metrics, natural in use but without potentials: none is certified.
"""

from ._axis_target import AxisTarget as AxisTarget
from ._collision import Collision as Collision
from ._cspace_target import CSpaceTarget as CSpaceTarget
from ._inertia import Inertia as Inertia
from ._joint_limit import JointLimit as JointLimit
from ._joint_velocity_cap import JointVelocityCap as JointVelocityCap
from ._position_target import PositionTarget as PositionTarget
from ._speed_damping import SpeedDamping as SpeedDamping
