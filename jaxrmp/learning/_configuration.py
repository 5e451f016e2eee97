"""What a skill is learned from and how: the content of a configuration file."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from .._errors import ConfigurationError, UnknownNameError
from ..kinematics import Robot, load_robot, panda
from ._preprocessing import PreprocessingSettings

ACTIVATIONS = ("relu", "softplus", "silu", "tanh")
LOSSES = ("smooth_l1", "l2")


def _require(section: str, settings: Any, positive: tuple[str, ...] = (), not_negative: tuple[str, ...] = ()) -> None:
    """Raise a `ConfigurationError` unless the named values, or all entries of the named lists, have the right sign."""
    for name in (*positive, *not_negative):
        value = getattr(settings, name)
        entries = value if isinstance(value, tuple) else (value,)
        least_ok = (lambda v: v > 0) if name in positive else (lambda v: v >= 0)
        if not entries or not all(math.isfinite(v) and least_ok(v) for v in entries):
            kind = "a positive number" if name in positive else "a number that is not negative"
            raise ConfigurationError(f"{section}.{name} is {value!r}, expected {kind}.")


@dataclass(frozen=True)
class Subtask:
    """One control point whose motion matters: `offset` [3], m, in the robot's frame `frame`."""

    name: str
    frame: str
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class TargetSettings:
    """Lengths in metres. `taper`: the target speed falls as tanh(distance / taper). `end_tolerance`: how far from
    their mean the ends may lie. `object_tolerance`: how far a tracked object may move during a demonstration."""

    taper: float = 0.03
    end_tolerance: float = 0.08
    object_tolerance: float = 0.1

    def __post_init__(self):
        _require("target", self, positive=("end_tolerance", "object_tolerance"), not_negative=("taper",))


@dataclass(frozen=True)
class PotentialSettings:
    """How the potential is fitted and its kernel width chosen; lengths in metres, see `choose_potential`."""

    widths: tuple[float, ...] = (0.02, 0.03, 0.04, 0.05, 0.06, 0.08)
    sharpness: float = 30.0
    regularization: float = 1e-4
    end_weight: float = 100.0
    basin_starts: int = 2000
    basin_margin: float = 0.3

    def __post_init__(self):
        _require("potential", self, positive=("widths", "sharpness", "end_weight", "basin_starts"))
        _require("potential", self, not_negative=("regularization", "basin_margin"))


@dataclass(frozen=True)
class MetricSettings:
    """The metric's network and training, see `train_metrics`. Every other sample is trained on, each with a copy
    displaced by normal noise of standard deviation `spread`, m, whose target velocity leads back to the demonstration
    over a length of `convergence`, m (if large: parallel to it), so that the field converges in a tube around the
    demonstrations. `reach`, m, of the metric's support around the demonstrations,
    beyond which it becomes the identity; 0 for the network everywhere, as published."""

    hidden: tuple[int, ...] = (128, 64)
    activation: str = "relu"
    offset: float = 1e-3
    length_scale: float = 0.1
    loss: str = "smooth_l1"
    updates: int = 1000
    learning_rate: float = 0.005
    weight_decay: float = 3e-5
    spread: float = 0.01
    convergence: float = 0.1
    reach: float = 0.05

    def __post_init__(self):
        _require(
            "metric", self, positive=("hidden", "offset", "length_scale", "updates", "learning_rate", "convergence")
        )
        _require("metric", self, not_negative=("weight_decay", "spread", "reach"))
        for name, valid in (("activation", ACTIVATIONS), ("loss", LOSSES)):
            if getattr(self, name) not in valid:
                raise UnknownNameError(name, getattr(self, name), valid)


@dataclass(frozen=True)
class PolicySettings:
    """Gains of the learned policy: cruise `speed`, m/s; `damping_rate`, 1/s; joint damping and limits as in leaves."""

    speed: float = 0.2
    damping_rate: float = 40.0
    joint_damping_weight: float = 2e-3
    joint_damping_rate: float = 10.0
    joint_limit_weight: float = 0.01
    joint_limit_sigma: float = 0.1
    joint_limit_barrier: float = 0.01
    joint_limit_reach: float = 0.1
    joint_limit_frequency: float = 50.0

    def __post_init__(self):
        _require("policy", self, positive=("speed", "damping_rate", "joint_damping_weight", "joint_limit_weight"))
        _require("policy", self, positive=("joint_limit_sigma", "joint_limit_reach", "joint_limit_frequency"))
        _require("policy", self, not_negative=("joint_damping_rate", "joint_limit_barrier"))


@dataclass(frozen=True)
class Configuration:
    """Everything that `learn` needs besides the demonstrations.

    `name` of the skill; `subtasks`, its control points; `robot`, "panda" or the path of an MJCF or URDF file;
    `fixed_joints`, joints of that file that stay at a value; `base`, the frame of the robot in which object poses were
    recorded; `object`, the tracked object whose frame the skill lives in, empty for the axes of `base` at the mean
    final position of the first control point.

    **Raises** `ConfigurationError` for values that make no sense.
    """

    name: str
    subtasks: tuple[Subtask, ...]
    robot: str = "panda"
    fixed_joints: Mapping[str, float] = field(default_factory=dict, hash=False)
    base: str = "world"
    object: str = ""
    seed: int = 0
    preprocessing: PreprocessingSettings = PreprocessingSettings()
    target: TargetSettings = TargetSettings()
    potential: PotentialSettings = PotentialSettings()
    metric: MetricSettings = MetricSettings()
    policy: PolicySettings = PolicySettings()

    def __post_init__(self):
        names = [subtask.name for subtask in self.subtasks]
        if not names or len(set(names)) < len(names):
            raise ConfigurationError(f"subtasks are named {names}, expected at least one and each name once.")
        if not re.fullmatch(r"\w[\w.-]*", self.name):
            raise ConfigurationError(
                f"name is {self.name!r}, expected letters, digits, '_', '-' or '.': files bear it."
            )
        if self.seed < 0:
            raise ConfigurationError(f"seed is {self.seed!r}, expected 0 or more.")
        if self.robot == "panda" and self.fixed_joints:
            raise ConfigurationError(
                f"fixed_joints is {dict(self.fixed_joints)!r}, but the built-in Panda has none to fix: its fingers are."
            )

    def load_robot(self) -> Robot:
        """The built-in Panda, or the robot of the MJCF or URDF file that is named. **Raises** as `load_robot`."""
        return panda() if self.robot == "panda" else load_robot(self.robot, fixed=self.fixed_joints)
