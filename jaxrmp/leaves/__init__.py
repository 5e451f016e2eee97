"""Leaves: one published policy a file."""

from ._joint_damping import JointDamping as JointDamping
from ._joint_limit import JointLimit as JointLimit
from ._learned import Learned as Learned
from ._learned import natural_gradient_field as natural_gradient_field
from ._nominal_potential import NominalPotential as NominalPotential
