"""NVIDIA's RMPflow configuration: the constants of the leaves, and the geometry of self-collision."""

import os
from typing import NamedTuple

import numpy as np

from ._yaml import Setting, read_yaml

# The keys of each section of `rmp_params`, which are the fields of the leaf that it stands for.
_COLLISION = (
    *("damping_gain", "damping_std_dev", "damping_robustness_eps", "damping_velocity_gate_length_scale"),
    *("repulsion_gain", "repulsion_std_dev", "metric_modulation_radius", "metric_scalar"),
    *("metric_exploder_std_dev", "metric_exploder_eps"),
)
_BOOST = ("proximity_metric_boost_scalar", "proximity_metric_boost_length_scale")
_REQUIRED = {
    "cspace_target_rmp": (
        *("metric_scalar", "position_gain", "damping_gain", "robust_position_term_thresh", "inertia"),
    ),
    "joint_limit_rmp": (
        *("metric_scalar", "metric_length_scale", "metric_exploder_eps", "metric_velocity_gate_length_scale"),
        *("accel_damper_gain", "accel_potential_gain"),
        *("accel_potential_exploder_length_scale", "accel_potential_exploder_eps"),
    ),
    "joint_velocity_cap_rmp": ("max_velocity", "velocity_damping_region", "damping_gain", "metric_weight"),
    "target_rmp": (
        *("accel_p_gain", "accel_d_gain", "accel_norm_eps", "metric_alpha_length_scale", "min_metric_alpha"),
        *("max_metric_scalar", "min_metric_scalar", *_BOOST),
    ),
    "axis_target_rmp": ("accel_p_gain", "accel_d_gain", "metric_scalar", *_BOOST),
    "collision_rmp": _COLLISION,
    "damping_rmp": ("accel_d_gain", "metric_scalar", "inertia"),
}
_OPTIONAL = {"point_cloud_obstacle_rmp": (*_COLLISION, "margin", "max_num_obstacles")}
# In shipped files, but nothing that they set ever acts in a policy.
_INACTIVE = {
    "cspace_trajectory_rmp": ("p_gain", "d_gain", "ff_gain", "weight"),
    "cspace_affine_rmp": ("final_handover_time_std_dev", "weight"),
}
_POSITIVE_ENDINGS = ("_length_scale", "_std_dev", "_eps", "_thresh", "_radius", "_region")
_FLAGS = {"target_rmp": ("accept_user_weights",), "axis_target_rmp": ("accept_user_weights",)}


class BaseCapsules(NamedTuple):
    """Capsules fixed in the robot's base frame: ends `start`, `end` [n, 3], m, and `radius` [n], m."""

    start: np.ndarray
    end: np.ndarray
    radius: np.ndarray


class RmpflowSettings(NamedTuple):
    """What an RMPflow configuration says.

    `gains[section][key]` are the constants; `controllers` are the frames, with radii, that keep off the `capsules`.
    """

    joint_limit_buffers: np.ndarray
    gains: dict[str, dict[str, float]]
    max_acceleration_norm: float
    projection_tolerance: float
    capsules: BaseCapsules
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
        known = {**_REQUIRED, **_OPTIONAL, **_INACTIVE}[name]
        entries = section.keys(known, flags)
        gains[name] = {key: _constant(entries[key]) for key in known}
        # Weights of a user's own are a feature of Lula's programming interface that a policy here has no need of.
        inactive += [f"{name}.{flag}" for flag in flags if flag in entries and entries[flag].boolean()]
        inactive += [name] if name in _INACTIVE else []

    resolve = top["canonical_resolve"].keys(["max_acceleration_norm", "projection_tolerance"], ["verbose"])
    limit, tolerance = (_positive(resolve[key]) for key in ("max_acceleration_norm", "projection_tolerance"))
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
        BaseCapsules(
            np.array([end["pt1"].numbers(3) for end in ends]).reshape(-1, 3),
            np.array([end["pt2"].numbers(3) for end in ends]).reshape(-1, 3),
            np.array([_constant(end["radius"]) for end in ends]),
        ),
        controllers,
        lines,
        tuple(inactive),
    )


def _constant(setting: Setting) -> float:
    value = setting.number()
    if setting.key.endswith(_POSITIVE_ENDINGS):
        return _positive(setting)
    if value < 0:
        setting.fail(f"must not be negative, received {value:g}")
    return value


def _positive(setting: Setting) -> float:
    value = setting.number()
    if value <= 0:
        setting.fail(f"must be positive, received {value:g}")
    return value
