"""Which links of a URDF may touch each other in physics: the file has no word for it."""

import itertools
import warnings
from collections import Counter
from typing import Any

import numpy as np

from .._errors import FileWarning
from ..kinematics import Robot
from ..kinematics._mujoco import compile_spec, import_mujoco
from ..world import self_pairs

_LOOKED_AT, _MOSTLY = 100, 0.25  # random configurations, and the share of them in which links touch that may


def let_neighbours_touch(spec: Any, robot: Robot) -> None:
    """Exclude contacts of links one joint apart, to which MuJoCo counts a base that stands still as scenery, and of
    links whose geometry meets in a quarter of random configurations: a `FileWarning` names these."""
    m = compile_spec(spec, str(robot.source))
    names = [m.body(int(b)).name for b in np.unique(m.geom_bodyid) if b > 0]
    apart = {frozenset((names[i], names[j])) for i, j in self_pairs(robot, names)}
    touching = Counter(pair for pairs in _touching(m, robot) for pair in pairs)
    mostly = {pair for pair in apart if touching[pair] > _MOSTLY * _LOOKED_AT}
    for pair in itertools.combinations(names, 2):
        if frozenset(pair) in mostly or frozenset(pair) not in apart:
            spec.add_exclude(bodyname1=pair[0], bodyname2=pair[1])
    if mostly:
        told = ", ".join(sorted(" - ".join(sorted(pair)) for pair in mostly))
        warnings.warn(
            f"{robot.source}: the geometry of {told} meets in more than a quarter of random configurations. In physics "
            "these links do not touch.",
            FileWarning,
            stacklevel=5,
        )


def _touching(m: Any, robot: Robot) -> list[set[frozenset[str]]]:
    """The pairs of bodies that touch, in each of some random configurations."""
    mujoco, found = import_mujoco(), []
    data, joints = mujoco.MjData(m), [joint for joint in robot.model.joints if joint.coordinate >= 0]  # followers too
    at, leader = [m.joint(joint.name).qposadr[0] for joint in joints], [joint.coordinate for joint in joints]
    multiplier, offset = (np.array([getattr(joint, key) for joint in joints]) for key in ("multiplier", "offset"))
    lower, upper = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    for q in np.random.default_rng(0).uniform(lower, upper, (_LOOKED_AT, robot.num_joints)):
        data.qpos[at] = multiplier * q[leader] + offset
        mujoco.mj_kinematics(m, data)
        mujoco.mj_collision(m, data)
        bodies = m.geom_bodyid[data.contact.geom[data.contact.dist < 0]]
        found.append({frozenset(m.body(int(b)).name for b in pair) for pair in bodies})
    return found
