"""Rolling policies out."""

from ._kinematic import Rollout as Rollout
from ._kinematic import rollout as rollout
