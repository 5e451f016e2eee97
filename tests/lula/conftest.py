"""NVIDIA's published files, where they are at hand."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from jaxrmp.io import load_lula
from jaxrmp.world import Boxes, Spheres, World


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


def world_of(golden):
    spheres, boxes = [], []
    for obstacle in golden["obstacles"]:
        if obstacle["type"] == "sphere":
            spheres.append((obstacle["center"], obstacle["radius"]))
        else:
            T = np.eye(4)
            T[:3, 3] = obstacle["center"]
            boxes.append((T, np.array(obstacle["side_lengths"]) / 2))
    return World(spheres=Spheres.of(spheres, capacity=4), boxes=Boxes.of(boxes, capacity=2))
