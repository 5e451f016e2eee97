"""MuJoCo scenes with their rules: the arm with a drawer, with a drawer behind a cylinder, with a cabinet door, or
yours."""

from ._alone import arm_alone as arm_alone
from ._door import door as door
from ._drawer import drawer as drawer
from ._drawer_obstacle import Cylinder as Cylinder
from ._drawer_obstacle import drawer_obstacle as drawer_obstacle
from ._gripper import Gripper as Gripper
from ._meshes import panda_meshes as panda_meshes
from ._meshes import picture_model as picture_model
from ._named import SCENES as SCENES
from ._named import scene as scene
from ._robot_spec import robot_spec as robot_spec
from ._scene import Left as Left
from ._scene import Plotted as Plotted
from ._scene import Scene as Scene
