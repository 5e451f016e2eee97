"""Rolling policies out."""

from ._arrival import Arrival as Arrival
from ._arrival import GoalWarning as GoalWarning
from ._arrival import arrival as arrival
from ._arrival import warn_if_out_of_reach as warn_if_out_of_reach
from ._kinematic import rollout as rollout
from ._rollout import Rollout as Rollout
from ._stable_step import StiffnessWarning as StiffnessWarning
from ._stable_step import stable_step as stable_step
from ._stable_step import warn_if_stiff as warn_if_stiff
