"""The same cover of a robot by fewer spheres and pairs, for what runs a thousand times a second."""

from dataclasses import replace

import numpy as np

from ..kinematics import Robot, on_moving_links
from ..world import RobotSpheres

Pairs = tuple[tuple[int, int], ...]


def lean(robot: Robot, spheres: RobotSpheres, pairs: Pairs) -> tuple[RobotSpheres, RobotSpheres, Pairs]:
    """Moving spheres, for obstacles; spheres and pairs of them for the robot itself. Nothing is lost: a sphere within
    another on the same link of `robot`, such as one on a locked finger within a box round the hand, is not needed where
    the other is there, nor a pair within a pair. All are on links that joints move, so that no other pose is asked for.
    """
    frames, offsets = on_moving_links(robot, spheres.frames, spheres.offsets)
    spheres = replace(spheres, frames=frames, offsets=offsets)
    outer = _outer(spheres)
    given = {frozenset(pair) for pair in pairs}
    kept = [p for p in pairs if (q := frozenset(int(outer[i]) for i in p)) == frozenset(p) or q not in given]
    used = sorted({i for pair in kept for i in pair})
    place = {i: k for k, i in enumerate(used)}
    own = tuple((place[i], place[j]) for i, j in kept)
    moving = spheres.moving(robot)  # of these alone: a base's sphere, which feels no obstacle, stands for none of them
    largest = np.flatnonzero(_outer(moving) == np.arange(moving.size))
    return moving.rows(largest.tolist()), spheres.rows(used), own


def _outer(spheres: RobotSpheres) -> np.ndarray:
    """For each sphere the largest one on its frame that it lies within, [K]: itself, if there is none."""
    radii, offsets, frames = np.asarray(spheres.radii), np.asarray(spheres.offsets), np.array(spheres.frames)
    outer = np.arange(len(radii))
    kept: list[int] = []
    for k in np.argsort(-radii, kind="stable").tolist():
        around = [j for j in kept if frames[j] == frames[k]]
        room = radii[around] - radii[k] - np.linalg.norm(offsets[around] - offsets[k], axis=-1)
        if (room >= 0).any():
            outer[k] = around[int(np.argmax(room >= 0))]
        else:
            kept.append(k)
    return outer
