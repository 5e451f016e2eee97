"""Policies on arms: a loop that drives one by a policy within its limits, watches it, and logs every cycle.

An `Arm` is a small interface; a Franka and an arm in a scene of MuJoCo have it, driven by the same loop.
"""

from ._arm import Arm as Arm
from ._arm import ArmState as ArmState
from ._arm import state_of as state_of
from ._drive import Drive as Drive
from ._drive import DriveEnd as DriveEnd
from ._drive import check_start as check_start
from ._drive import drive as drive
from ._drive import slots_of as slots_of
from ._franka_arm import FR3_LIMITS as FR3_LIMITS
from ._franka_arm import FrankaArm as FrankaArm
from ._law import Law as Law
from ._law import Looked as Looked
from ._law import Step as Step
from ._law import law as law
from ._limits import Limited as Limited
from ._limits import MotionLimits as MotionLimits
from ._limits import brake as brake
from ._limits import limited as limited
from ._log import Log as Log
from ._log import check_log_folder as check_log_folder
from ._log import save_mcap as save_mcap
from ._log import save_motion as save_motion
from ._mujoco_arm import MujocoArm as MujocoArm
from ._mujoco_arm import SceneTracker as SceneTracker
from ._record import record as record
from ._sightings import Fixed as Fixed
from ._sightings import Sighting as Sighting
from ._sightings import Sightings as Sightings
from ._sightings import UdpSightings as UdpSightings
from ._to_posture import to_posture as to_posture
from ._watch import DriveSettings as DriveSettings
from ._watch import Watch as Watch
