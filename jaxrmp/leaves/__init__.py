"""Leaves: one published policy a file; `lula` holds NVIDIA's."""

from . import lula as lula
from ._attractor import Attractor as Attractor
from ._collision_avoidance import CollisionAvoidance as CollisionAvoidance
from ._cruising_attractor import CruisingAttractor as CruisingAttractor
from ._damping import Damping as Damping
from ._detour import Detour as Detour
from ._direction_attractor import DirectionAttractor as DirectionAttractor
from ._formation import Formation as Formation
from ._funnel import Funnel as Funnel
from ._joint_limit import JointLimit as JointLimit
from ._joint_velocity_limit import JointVelocityLimit as JointVelocityLimit
from ._learned import Learned as Learned
from ._learned import natural_gradient_field as natural_gradient_field
from ._nominal_potential import NominalPotential as NominalPotential
from ._orientation_attractor import OrientationAttractor as OrientationAttractor
from ._posture import Posture as Posture
from ._stretched_attractor import StretchedAttractor as StretchedAttractor
