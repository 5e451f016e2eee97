"""MuJoCo scenes: the arm with a drawer, with a drawer behind a cylinder, with a cabinet door."""

from ._meshes import panda_meshes as panda_meshes
from ._scene import SCENES as SCENES
from ._scene import Cylinder as Cylinder
from ._scene import Scene as Scene
from ._scene import picture_model as picture_model
from ._scene import scene as scene
