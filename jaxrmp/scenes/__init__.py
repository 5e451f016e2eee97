"""MuJoCo scenes: the arm with a drawer, with a drawer behind a cylinder, with a cabinet door."""

from ._scene import SCENES as SCENES
from ._scene import Cylinder as Cylinder
from ._scene import Scene as Scene
from ._scene import scene as scene
