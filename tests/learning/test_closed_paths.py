"""Motions that no stable policy can follow are refused before anything is optimised; near ones are not."""

from dataclasses import replace

import numpy as np
import pytest

from jaxrmp import DemonstrationError
from jaxrmp.kinematics import panda
from jaxrmp.learning import Configuration, Demonstration, DemonstrationSet, Subtask, prepare
from jaxrmp.learning._closed_paths import check_paths

STIR = Configuration("stir", (Subtask("hand", "panda_hand_tcp"),))


def stirring(turn, count=3):
    """The hand goes round by `turn`, rad, by the first and the fourth joint, faster and slower in each recording."""
    recordings = []
    for k in range(count):
        time = np.linspace(0.0, 4.0 + k, 150)
        a = turn * time / time[-1]
        q = np.tile([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8], (150, 1))
        q[:, 0] += 0.3 * np.cos(a) + 0.01 * k
        q[:, 3] += 0.25 * np.sin(a)
        recordings.append(Demonstration(time, q))
    return DemonstrationSet(tuple(recordings), panda().joint_names, "panda")


def test_a_motion_that_ends_where_it_began_is_refused_in_these_words():
    begins = r"'hand' ends where it began in demonstration 0 \(0.0 cm, after 2\d cm away at sample [67]\d\), 1 .*, 2 "
    with pytest.raises(DemonstrationError, match=begins + ".*stable policy rests at its goal"):
        prepare(STIR, panda(), stirring(2 * np.pi))


def test_a_motion_that_crosses_itself_is_refused_with_its_samples():
    with pytest.raises(
        DemonstrationError, match=r"'hand' crosses its own path in demonstration 0 \(samples (\d+) and "
    ):
        prepare(STIR, panda(), stirring(3 * np.pi))


def test_a_motion_that_nearly_closes_is_prepared():
    assert prepare(STIR, panda(), stirring(1.8 * np.pi)).subtasks.positions.shape == (1, 3, 200, 3)


LENGTH = np.linspace(0, 1, 200)[:, None]


def eight(height):
    """A figure of eight that passes above itself by `height`, m, cut open at the end."""
    a = -0.5 + 5.0 * LENGTH
    return 0.2 * np.concatenate([np.sin(a), np.sin(2 * a), np.zeros_like(a)], axis=1) + [0, 0, height] * LENGTH


def wiping():
    """Out by 30 cm, and half of the way back on the same line."""
    return np.concatenate([0.4 * np.minimum(LENGTH, 1.5 - LENGTH), 0 * LENGTH, 0 * LENGTH], axis=1)


def trembling():
    return np.concatenate([0.3 * LENGTH, 0.01 * np.sin(60 * LENGTH), 0.01 * np.cos(60 * LENGTH)], axis=1)


def checked(path):
    path = np.asarray(path)
    check_paths((path - path[-1])[None, None], ["hand"], 0.01, lambda k, n, fraction: round(1000 * fraction))


@pytest.mark.parametrize("path", [eight(0.0), eight(0.005), wiping()])
def test_crossing_at_half_the_width_of_the_tube_counts(path):
    with pytest.raises(DemonstrationError, match="crosses its own path"):
        checked(path)


@pytest.mark.parametrize("path", [eight(0.05), trembling(), LENGTH * [0.3, 0.1, 0.0], LENGTH * [1e-3, 0, 0]])
def test_passing_near_or_trembling_does_not(path):
    checked(path)


def test_a_minority_is_named():
    some = stirring(1.0)
    closed = stirring(2 * np.pi)[1]
    mixed = replace(some, demonstrations=(some[0], closed, some[2]))
    tolerant = replace(STIR, target=replace(STIR.target, end_tolerance=1.0))
    with pytest.raises(DemonstrationError, match=r"ends where it began in demonstration 1 \([^)]*\)\. A stable"):
        prepare(tolerant, panda(), mixed)
