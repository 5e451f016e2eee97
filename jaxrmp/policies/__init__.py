"""Policies for whole arms: pieces for any robot, which add up with `+`, and two compositions of them.

A piece is a node on joint space. It takes the gains of its leaf by keyword, or another leaf as `leaf`; where a robot
lacks what the piece is about, it is `NOTHING`, which adds nothing.
"""

from ._arm_policy import ArmPolicy as ArmPolicy
from ._arm_policy import reaching_policy as reaching_policy
from ._arm_policy import whole_arm_policy as whole_arm_policy
from ._detour import Aside as Aside
from ._detour import FoundDetour as FoundDetour
from ._detour import detour as detour
from ._detour import find_detour as find_detour
from ._detour import goal_distance as goal_distance
from ._distances import AVOIDANCE as AVOIDANCE
from ._distances import SELF_AVOIDANCE as SELF_AVOIDANCE
from ._distances import avoidance as avoidance
from ._distances import self_avoidance as self_avoidance
from ._guided import FIRM_AVOIDANCE as FIRM_AVOIDANCE
from ._guided import FIRM_SELF_AVOIDANCE as FIRM_SELF_AVOIDANCE
from ._guided import guide as guide
from ._guided import guided as guided
from ._hand import HAND_ORIENTATION as HAND_ORIENTATION
from ._hand import HAND_POSITION as HAND_POSITION
from ._hand import HandGoal as HandGoal
from ._hand import hand_at as hand_at
from ._joints import NOTHING as NOTHING
from ._joints import damping as damping
from ._joints import joint_limits as joint_limits
from ._joints import posture as posture
from ._joints import velocity_limits as velocity_limits
from ._posture_search import FoundPosture as FoundPosture
from ._posture_search import find_posture as find_posture
from ._rest_search import find_rest as find_rest
from ._upright import UPRIGHT as UPRIGHT
from ._upright import upright as upright
