"""Scenes by their names, or from a file of one's own."""

import importlib.util
import inspect
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from .._errors import ConfigurationError, UnknownNameError
from ._door import door
from ._drawer import drawer
from ._drawer_obstacle import drawer_obstacle
from ._scene import Scene

SCENES: dict[str, Callable[..., Scene]] = {"drawer": drawer, "drawer_obstacle": drawer_obstacle, "door": door}
"""The scenes that are there, by name: functions of `T_world_object`."""


def scene(named: str, *, T_world_object: np.ndarray | None = None) -> Scene:
    """The scene of a name, or of a file: `FILE.py`, whose function `scene` gives it, or `FILE.py:function`.

    Such a function takes `T_world_object` [4, 4], where the object stands, None for the scene's own place.

    **Arguments**: `named`, one of `SCENES` or a file; `T_world_object`, the frame that the skill speaks of
    (`Skill.T_world_object`), by default where the scene has it.
    **Raises** `UnknownNameError` for another name, or a function that is not in the file; `ConfigurationError` for a
    file that cannot be run or gives no scene; `RigidTransformError`; `MissingDependencyError` without mujoco.
    """
    if named in SCENES:
        return SCENES[named](T_world_object)
    file, _, function = named.partition(".py")
    if not (named.endswith(".py") or ".py:" in named):
        raise UnknownNameError("scene", named, SCENES, "Or give a file: FILE.py, or FILE.py:function.")
    path, name = Path(file + ".py"), function.lstrip(":") or "scene"
    if not path.is_file():
        raise ConfigurationError(f"scene {str(path)!r}: there is no such file.")
    spec = importlib.util.spec_from_file_location(f"scene_of_{path.stem}", path)
    assert spec is not None and spec.loader is not None  # of any file that ends in .py
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # as dataclasses want it
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # whatever the file raises
        raise ConfigurationError(f"scene {str(path)!r} cannot be run: {type(error).__name__}: {error}") from error
    functions = [key for key, value in vars(module).items() if inspect.isfunction(value)]
    UnknownNameError.check(f"function of {str(path)!r}", name, functions, "Write one, or name it: FILE.py:function.")
    found = getattr(module, name)(T_world_object)
    if not isinstance(found, Scene):
        raise ConfigurationError(f"scene {named!r} gave a {type(found).__name__}, expected a jaxrmp.scenes.Scene.")
    return found
