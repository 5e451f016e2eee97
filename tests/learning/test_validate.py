"""Validation: learning with each demonstration left out in turn, and reproducing the one left out."""

import collections
import json
import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jaxrmp import DemonstrationError
from jaxrmp.cli._output import validation_table
from jaxrmp.kinematics import panda
from jaxrmp.learning import Fold, Validation, leave_one_out, load_configuration, validate
from jaxrmp.synthetic import synthetic_demonstrations

CONFIGS = Path(__file__).parents[2] / "configs"
FEW = {"method": "flow", "flow.updates": 200, "flow.couplings": 4, "flow.hidden": 16}


@pytest.fixture(scope="module")
def drawer():
    return synthetic_demonstrations("drawer_closing", count=3)


def test_each_is_left_out_in_turn_and_programs_are_compiled_once(drawer, caplog):
    """No object is tracked: the frame of each fold is its own, and the one left out is seen from there."""
    configuration = load_configuration(CONFIGS / "drawer_closing.toml", FEW)
    with caplog.at_level(logging.DEBUG, "jax._src.interpreters.pxla"):  # in all threads
        found = validate(configuration, panda(), drawer)
    compiled = collections.Counter(r.args[0] for r in caplog.records if r.msg.startswith("Compiling"))
    assert compiled["jit(_updates)"] == 1 and compiled["jit(_carried)"] == 1
    assert compiled["jit(_rollouts)"] == 2  # of all that are learned from, and of one alone
    assert [fold.left_out for fold in found.folds] == [0, 1, 2] and found.passed == 3
    assert found.held_out["dtw_cm"] == pytest.approx(np.mean([fold.held_out["dtw_cm"] for fold in found.folds]))
    assert found.training["goal_cm"] < 1 and found.held_out["goal_cm"] < 1  # to where that one ended
    assert found.held_out["dtw_cm"] > 1.2 * found.training["dtw_cm"]


def test_folds_that_fail_are_told_and_not_counted(drawer):
    wild = {"flow.learning_rate": 10.0, "flow.conditioning": 0.0, "flow.updates": 100}
    configuration = load_configuration(CONFIGS / "drawer_closing.toml", FEW | wild)
    found = validate(configuration, panda(), drawer)
    assert found.passed == 0 and found.held_out is None
    assert all(fold.failed and fold.held_out is None for fold in found.folds)
    errors = {"dtw_cm": 2.0, "frechet_cm": 4.0, "goal_cm": 0.0}
    found = Validation((Fold(0, "flow", errors, errors), found.folds[1]))
    assert found.held_out == errors and found.passed == 1
    said = validation_table(found.as_dict())
    assert "without demonstration 1" in said and "the 1 of 2 folds that passed" in said
    assert json.loads(json.dumps(found.as_dict()))["folds"][1]["held_out"] is None


def test_two_demonstrations_are_too_few(drawer):
    two = replace(drawer, demonstrations=drawer.demonstrations[:2])
    with pytest.raises(DemonstrationError, match="takes three"):
        leave_one_out(two)
