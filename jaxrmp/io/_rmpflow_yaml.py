"""NVIDIA's RMPflow configuration: the constants of the leaves, and the geometry of self-collision."""

import os
from typing import NamedTuple

import numpy as np

from .._ranges import FINITE, ranges_of
from ..leaves import lula
from ..world import Capsules
from ._yaml import Setting, read_yaml

# The leaf that a section of `rmp_params` stands for, whose gains are its keys, and the keys that it has besides.
_REQUIRED = {
    "cspace_target_rmp": (lula.CSpaceTarget, "inertia"),
    "joint_limit_rmp": (lula.JointLimit,),
    "joint_velocity_cap_rmp": (lula.JointVelocityCap,),
    "target_rmp": (lula.PositionTarget,),
    "axis_target_rmp": (lula.AxisTarget,),
    "collision_rmp": (lula.Collision,),
    "damping_rmp": (lula.SpeedDamping, "inertia"),
}
_OPTIONAL = {"point_cloud_obstacle_rmp": (lula.Collision, "margin", "max_num_obstacles")}
# In shipped files, but nothing that they set ever acts in a policy.
_INACTIVE = {
    "cspace_trajectory_rmp": (None, "p_gain", "d_gain", "ff_gain", "weight"),
    "cspace_affine_rmp": (None, "final_handover_time_std_dev", "weight"),
}
_POSITIVE_ENDINGS = ("_length_scale", "_std_dev", "_eps", "_thresh", "_radius", "_region", "_norm", "_tolerance")
_FLAGS = {"target_rmp": ("accept_user_weights",), "axis_target_rmp": ("accept_user_weights",)}


class RmpflowSettings(NamedTuple):
    """What an RMPflow configuration says.

    `gains[section][key]` are the constants; `controllers` are the frames, with radii, that keep off the `capsules`,
    which are fixed in the robot's base frame.
    """

    joint_limit_buffers: np.ndarray
    gains: dict[str, dict[str, float]]
    max_acceleration_norm: float
    projection_tolerance: float
    capsules: Capsules
    controllers: dict[str, float]
    controller_lines: dict[str, Setting]
    inactive: tuple[str, ...]


def read_rmpflow(path: str | os.PathLike, num_joints: int) -> RmpflowSettings:
    """Read an RMPflow configuration of NVIDIA's for a robot of `num_joints` joints.

    **Raises** `UnknownNameError` for a key that is not theirs, `ConfigurationError` for a missing key and for a value
    of a wrong type or sign; both name the key and the line.
    """
    top = read_yaml(path).keys(
        ["joint_limit_buffers", "rmp_params", "canonical_resolve"],
        ["format", "api_version", "body_capsules", "body_cylinders", "body_collision_controllers"],
    )
    if "format" in top and top["format"].text() != "rmpflow":
        top["format"].refuse("rmpflow")
    buffers = np.array(top["joint_limit_buffers"].numbers(num_joints))
    if (buffers < 0).any():
        top["joint_limit_buffers"].fail(f"buffers must not be negative, received {buffers.tolist()}")

    sections = top["rmp_params"].keys(_REQUIRED, [*_OPTIONAL, *_INACTIVE])
    gains, inactive = {}, []
    for name, section in sections.items():
        flags = _FLAGS.get(name, ())
        leaf, *besides = {**_REQUIRED, **_OPTIONAL, **_INACTIVE}[name]
        ranges = ranges_of(leaf) if leaf else []  # of its gains; a target, which is but finite, is none
        known = [*dict.fromkeys(key for key, kind in ranges if kind is not FINITE), *besides]
        entries = section.keys(known, flags)
        gains[name] = {key: _constant(entries[key]) for key in known}
        # Weights of a user's own are a feature of Lula's programming interface that a policy here has no need of.
        inactive += [f"{name}.{flag}" for flag in flags if flag in entries and entries[flag].boolean()]
        inactive += [name] if name in _INACTIVE else []

    resolve = top["canonical_resolve"].keys(["max_acceleration_norm", "projection_tolerance"], ["verbose"])
    limit, tolerance = (_constant(resolve[key]) for key in ("max_acceleration_norm", "projection_tolerance"))
    if "verbose" in resolve:
        resolve["verbose"].boolean()

    controllers, lines = {}, {}
    for entry in top["body_collision_controllers"].items() if "body_collision_controllers" in top else []:
        keys = entry.keys(["name", "radius"])
        frame = keys["name"].text()
        if frame in controllers:
            keys["name"].fail(f"frame {frame} was given in line {lines[frame].line}")
        controllers[frame], lines[frame] = _constant(keys["radius"]), keys["name"]
    # Each capsule is named, but its name is no frame: ends are in the base frame. Older files call them cylinders.
    capsules = [entry for kind in ("body_capsules", "body_cylinders") if kind in top for entry in top[kind].items()]
    ends = [entry.keys(["name", "pt1", "pt2", "radius"]) for entry in capsules]
    return RmpflowSettings(
        buffers,
        gains,
        limit,
        tolerance,
        Capsules.of((end["pt1"].numbers(3), end["pt2"].numbers(3), _constant(end["radius"])) for end in ends),
        controllers,
        lines,
        tuple(inactive),
    )


def _constant(setting: Setting) -> float:
    value, positive = setting.number(), setting.key.endswith(_POSITIVE_ENDINGS)
    if value < 0 or (positive and value == 0):
        setting.fail(f"must {'be positive' if positive else 'not be negative'}, received {value:g}")
    return value
