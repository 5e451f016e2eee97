"""What all tests share: compiled programs kept between runs, and the real recordings where they are at hand."""

import os
from pathlib import Path

import jax
import pytest

if not os.environ.get("JAX_COMPILATION_CACHE_DIR"):
    jax.config.update("jax_compilation_cache_dir", str(Path(__file__).parent.parent / ".jax_cache"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder of the real recordings, or a skipped test that says why."""
    folder = Path(os.environ.get("JAXRMP_DATA") or os.devnull) / "franka"
    if not folder.is_dir():
        pytest.skip("needs the real recordings: set JAXRMP_DATA to the folder that holds franka/")
    return folder
