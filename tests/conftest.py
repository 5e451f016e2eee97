"""What all tests share: compiled programs kept between runs, and the real recordings where they are at hand."""

import ctypes.util
import os
import sys
from pathlib import Path

import jax
import pytest

if not os.environ.get("JAX_COMPILATION_CACHE_DIR"):
    jax.config.update("jax_compilation_cache_dir", str(Path(__file__).parent.parent / ".jax_cache"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)

DISPLAY = bool(os.environ.get("MUJOCO_GL") or os.environ.get("DISPLAY")) or sys.platform != "linux"
if not DISPLAY and ctypes.util.find_library("OSMesa"):
    os.environ["MUJOCO_GL"] = "osmesa"  # read when mujoco is imported, whichever test does so first
    DISPLAY = True


@pytest.fixture(scope="session")
def can_draw() -> bool:
    """Whether MuJoCo can draw here: with a display or with OSMesa, which `make test` installs as root."""
    return DISPLAY


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder of the real recordings, or a skipped test that says why."""
    folder = Path(os.environ.get("JAXRMP_DATA") or os.devnull) / "franka"
    if not folder.is_dir():
        pytest.skip("needs the real recordings: set JAXRMP_DATA to the folder that holds franka/")
    return folder
