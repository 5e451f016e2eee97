"""The world around the robot: obstacles, signed distances, and the task maps from joint positions to distances."""

from ._boxes import Boxes as Boxes
from ._capsule_distances import CapsuleDistances as CapsuleDistances
from ._capsules import Capsules as Capsules
from ._cylinders import Cylinders as Cylinders
from ._grid import SignedDistanceGrid as SignedDistanceGrid
from ._half_spaces import HalfSpaces as HalfSpaces
from ._mesh_grid import grid_of_mesh as grid_of_mesh
from ._never_near import without_never_near as without_never_near
from ._obstacle_distances import ObstacleDistances as ObstacleDistances
from ._obstacles import FAR as FAR
from ._obstacles import Obstacles as Obstacles
from ._own_spheres import own_self_pairs as own_self_pairs
from ._own_spheres import own_spheres as own_spheres
from ._panda_cover import panda_spheres as panda_spheres
from ._robot_spheres import RobotSpheres as RobotSpheres
from ._robot_spheres import geometry_of_model as geometry_of_model
from ._robot_spheres import spheres_from_model as spheres_from_model
from ._self_clearance import SelfClearance as SelfClearance
from ._self_clearance import self_clearance as self_clearance
from ._self_distances import SelfDistances as SelfDistances
from ._self_pairs import ignored_by_model as ignored_by_model
from ._self_pairs import panda_self_pairs as panda_self_pairs
from ._self_pairs import self_pairs as self_pairs
from ._spheres import Spheres as Spheres
from ._world import World as World
from ._world import ignored_in as ignored_in
