"""The examples in docstrings run and print what they say."""

import doctest
import importlib

import pytest

MODULES = ["_forms", "_task_map", "_tree", "_certificate", "simulation._kinematic"]


@pytest.mark.parametrize("name", MODULES)
def test_examples_in_docstrings(name):
    found = doctest.testmod(importlib.import_module(f"jaxrmp.{name}"))
    assert found.attempted > 0
    assert found.failed == 0
