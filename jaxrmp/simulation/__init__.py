"""Rolling policies out."""

from ._kinematic import Rollout as Rollout
from ._kinematic import rollout as rollout
from ._stable_step import StiffnessWarning as StiffnessWarning
from ._stable_step import stable_step as stable_step
from ._stable_step import warn_if_stiff as warn_if_stiff
