"""Riemannian motion policies: learned from demonstrations, composed with hand-designed ones, certified stable."""

import importlib as _importlib

from . import inspection as inspection
from . import kinematics as kinematics
from . import leaves as leaves
from . import world as world
from ._certificate import Certificate as Certificate
from ._certificate import certificate as certificate
from ._certificate import uncertified_leaves as uncertified_leaves
from ._errors import ArmError as ArmError
from ._errors import BasinError as BasinError
from ._errors import CalibrationError as CalibrationError
from ._errors import ConfigurationError as ConfigurationError
from ._errors import ConvexProgramError as ConvexProgramError
from ._errors import DemonstrationError as DemonstrationError
from ._errors import ExportError as ExportError
from ._errors import FileWarning as FileWarning
from ._errors import FramesError as FramesError
from ._errors import JaxrmpError as JaxrmpError
from ._errors import LeafError as LeafError
from ._errors import MissingDependencyError as MissingDependencyError
from ._errors import NoGeometryError as NoGeometryError
from ._errors import RigidTransformError as RigidTransformError
from ._errors import RobotError as RobotError
from ._errors import RolloutError as RolloutError
from ._errors import ShapeError as ShapeError
from ._errors import SkillFileError as SkillFileError
from ._errors import TrainingError as TrainingError
from ._errors import UnknownNameError as UnknownNameError
from ._errors import UnsafeFileWarning as UnsafeFileWarning
from ._first_order import overdamped_velocity as overdamped_velocity
from ._first_order import velocity as velocity
from ._forms import CanonicalForm as CanonicalForm
from ._forms import DiagonalForm as DiagonalForm
from ._forms import NaturalForm as NaturalForm
from ._forms import canonical as canonical
from ._forms import natural as natural
from ._forms import resolve as resolve
from ._gds import GeometricDynamicalSystem as GeometricDynamicalSystem
from ._gds import SeparableGDS as SeparableGDS
from ._map_tree import map_tree as map_tree
from ._pytree import pytree as pytree
from ._pytree import static as static
from ._task_map import Affine as Affine
from ._task_map import Composition as Composition
from ._task_map import Distance as Distance
from ._task_map import Identity as Identity
from ._task_map import Pointwise as Pointwise
from ._task_map import Pushforward as Pushforward
from ._task_map import RigidTransform as RigidTransform
from ._task_map import Selection as Selection
from ._task_map import Stack as Stack
from ._task_map import TaskMap as TaskMap
from ._task_map import Translation as Translation
from ._task_map import Transport as Transport
from ._task_map import compose as compose
from ._task_map import pushforward as pushforward
from ._task_map import stack as stack
from ._task_map import transport as transport
from ._tree import Batched as Batched
from ._tree import Leaf as Leaf
from ._tree import Node as Node
from ._tree import Pullback as Pullback
from ._tree import Scaled as Scaled
from ._tree import SeparableLeaf as SeparableLeaf
from ._tree import Sum as Sum
from ._tree import acceleration as acceleration
from ._tree import batched as batched
from ._tree import pullback as pullback
from ._trust_region import resolve_within as resolve_within
from ._version import __version__ as __version__
from ._visitor import Measured as Measured
from ._visitor import Visitor as Visitor
from .xla import Compiled as Compiled
from .xla import compiled as compiled

_ON_FIRST_USE = (
    "environments",
    "evaluation",
    "export",
    "hardware",
    "io",
    "learning",
    "perception",
    "policies",
    "scenes",
    "sequences",
    "simulation",
    "synthetic",
    "viewer",
    "visualization",
)


def __getattr__(name):
    if name in _ON_FIRST_USE:
        return _importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__():
    return sorted({*globals(), *_ON_FIRST_USE})
