"""NVIDIA's published files, where they are at hand."""

import json
import os
from pathlib import Path

import pytest

from jaxrmp.io import load_lula


@pytest.fixture(scope="session")
def folder() -> Path:
    folder = Path(os.environ.get("JAXRMP_DATA") or os.devnull) / "lula"
    if not folder.is_dir():
        pytest.skip("needs NVIDIA's published files: set JAXRMP_DATA to the folder that holds lula/")
    return folder


@pytest.fixture(scope="session")
def golden(folder):
    return json.loads((folder / "golden_franka.json").read_text())


@pytest.fixture(scope="session")
def policy(folder, golden):
    return load_lula(*(folder / golden[name] for name in ("urdf", "xrdf", "config")))
