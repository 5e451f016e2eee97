"""The joints of a URDF as an XRDF wants them: some move, the others are locked at their default positions."""

import os
import warnings

import numpy as np

from .._errors import FileWarning
from ..kinematics import Robot, load_robot
from ._xrdf import Xrdf, warn

_ROUNDING = 1e-3  # rad or m: files round to three or four digits, and a limit is often a multiple of pi


def load_with_defaults(urdf: str | os.PathLike, description: Xrdf, source: str) -> tuple[Robot, dict[str, float]]:
    """The robot of a `urdf`, its joints outside the `cspace` of `description` locked, and all default positions.

    A default within 1e-3 of a limit is at that limit; a joint without one is at zero or the nearest limit. A joint that
    follows another is where that puts it. Warns with `FileWarning` of joints without a default, and of defaults that
    are of no use.
    **Raises** `ConfigurationError`, by key and line, for a default beyond the limits; `UnknownNameError` for a joint of
    `cspace` that is not there.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FileWarning)  # said below, of the joints that are not locked
        robot = load_robot(urdf)
    moving, names = description.joint_names.texts(), robot.joint_names
    for name in moving:
        if name not in names:
            robot.joint_index(name)
    twice = [name for name in moving if moving.count(name) > 1]
    if twice:
        description.joint_names.fail(f"joint {twice[0]} is named twice")
    given, unused = {}, []
    for name, setting in description.default_joint_positions.items():
        joint = next((joint for joint in robot.model.joints if joint.name == name), None)
        if joint is None:
            unused.append(name)
        elif name in names:
            given[name] = setting.number(), setting
    for joint in robot.model.joints:
        setting = description.default_joint_positions.get(joint.name)
        if setting is None or joint.name in names:
            continue
        leader = names[joint.coordinate] if joint.coordinate >= 0 else None
        if leader and leader not in given and leader not in moving and joint.multiplier:
            given[leader] = (setting.number() - joint.offset) / joint.multiplier, setting
        position = joint.multiplier * given.get(leader, (0.0,))[0] + joint.offset
        if abs(position - setting.number()) > _ROUNDING:
            unused.append(f"{joint.name} (it follows {leader or 'none'}, to {position:.4g})")
    defaults, silent = {}, []
    for name, lower, upper in zip(names, np.asarray(robot.lower), np.asarray(robot.upper), strict=True):
        value, setting = given.get(name, (0.0, None))
        defaults[name] = float(np.clip(value, lower, upper))
        if setting is None:
            silent.append(f"{name} at {defaults[name]:.4g}")
        elif abs(value - defaults[name]) > _ROUNDING:
            setting.fail(f"{value:g} is outside the limits of joint {name}, from {lower:g} to {upper:g}")
    if unused:
        warn(
            f"{source}: default_joint_positions of {', '.join(unused)} are left out: the URDF has no such joint that "
            "moves by itself."
        )
    if silent:
        warn(
            f"{source}: default_joint_positions says nothing of {', '.join(silent)}, which is assumed. Give them "
            "positions."
        )
    return load_robot(urdf, fixed={name: q for name, q in defaults.items() if name not in moving}), defaults
