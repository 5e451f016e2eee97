"""What a skill is learned from and how: the content of a configuration file."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Literal, get_args

import numpy as np

from .._errors import ConfigurationError, UnknownNameError
from .._pytree import set_field
from .._ranges import NonNegative, Positive, settings
from ..kinematics import Robot, load_robot, panda
from ..leaves import Damping, JointLimit
from ._pose_settings import PoseSettings
from ._preprocessing import PreprocessingSettings
from ._recording import RecordingSettings

ACTIVATIONS = ("relu", "softplus", "silu", "tanh")
LOSSES = ("smooth_l1", "l2")
Method = Literal["auto", "flow", "paper"]
Kind = Literal["points", "pose", "orientation"]
Tempo = Literal["constant", "demonstrated"]
_SOME_RANGE = {"lower": np.zeros(1), "upper": np.ones(1), "rest": np.zeros(1)}  # a robot's, not a configuration's


@dataclass(frozen=True)
class Subtask:
    """What moves, `name`: by `kind` "points" a control point, `offset` [3], m, in the robot's frame `frame`; by "pose"
    that point and how the frame is turned; by "orientation" how it is turned alone, wherever it is.

    **Raises** `UnknownNameError` for another kind, `ConfigurationError` for an orientation of a point."""

    name: str
    frame: str
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    kind: Kind = "points"

    def __post_init__(self):
        UnknownNameError.check("kind of subtask", self.kind, get_args(Kind))
        if self.kind == "orientation" and any(self.offset):
            raise ConfigurationError(
                f"subtask {self.name!r} has offset {self.offset!r}, but an orientation is of the whole frame "
                f"{self.frame!r}: leave the offset out, or set kind to 'pose' if the place of that point matters."
            )


@settings("target")
class TargetSettings:
    """Lengths in metres. `taper`: the target speed falls as tanh(distance / taper). `end_tolerance`: how far from
    their mean the ends may lie. `object_tolerance`: how far a tracked object may move during a demonstration."""

    taper: NonNegative[float] = 0.03
    end_tolerance: Positive[float] = 0.08
    object_tolerance: Positive[float] = 0.1


@settings("potential")
class PotentialSettings:
    """How the potential is fitted and its width chosen; arguments as `choose_potential` and `fit_potential`."""

    widths: Positive[tuple[float, ...]] = (0.02, 0.03, 0.04, 0.05, 0.06, 0.08)
    sharpness: Positive[float] = 30.0
    regularization: NonNegative[float] = 1e-4
    end_weight: Positive[float] = 100.0
    basin_starts: Positive[int] = 2000
    basin_margin: NonNegative[float] = 0.3


@settings("metric")
class MetricSettings:
    """The metric's network and training, arguments as `train_metrics`. Every other sample is trained on, each with a
    copy displaced by normal noise of standard deviation `spread`, m, whose target velocity leads back to the
    demonstration over a length of `convergence`, m (if large: parallel to it), so that the field converges in a tube
    around the demonstrations. `reach`, m, of the metric's support around the demonstrations, beyond which it becomes
    the identity; 0 for the network everywhere, as published."""

    hidden: Positive[tuple[int, ...]] = (128, 64)
    activation: str = "relu"
    offset: Positive[float] = 1e-3
    length_scale: Positive[float] = 0.1
    loss: str = "smooth_l1"
    updates: Positive[int] = 1000
    learning_rate: Positive[float] = 0.005
    weight_decay: NonNegative[float] = 3e-5
    spread: NonNegative[float] = 0.01
    convergence: Positive[float] = 0.1
    reach: NonNegative[float] = 0.05

    def __post_init__(self):
        UnknownNameError.check("activation", self.activation, ACTIVATIONS)
        UnknownNameError.check("loss", self.loss, LOSSES)


@settings("flow")
class FlowSettings:
    """The flow and its training. `couplings` L and `hidden`, the width of their networks; `updates`, half as many again
    with a demonstrated tempo, and `learning_rate`; `mixtures`, paths between two demonstrations that are followed too,
    an update; `displaced`, how many more with their start displaced, by normal noise of standard deviation
    `displacement`, m; `conditioning`, against stretching space near the demonstrations; `identity`, to leave space as
    it is far from them; `circumradius`, m, of the triangle of points that stands for the hand: what its turn counts
    for; `weight`, the metric of the policy.

    `funnel`: 0 for none, else the metric of the leaf that leads joints back to the ways from demonstrated starts;
    `onset`, rad, how far from them it begins to lead along them, `inner`, towards them, and `outer`, where both are
    whole; `lead`, how strong along is beside towards. `posture`: the metric of a faint pull to where joints end, which
    settles what the hand leaves open."""

    couplings: Positive[int] = 12
    hidden: Positive[int] = 32
    updates: Positive[int] = 4000
    learning_rate: Positive[float] = 0.005
    mixtures: NonNegative[int] = 4
    displaced: NonNegative[int] = 1
    displacement: NonNegative[float] = 0.1
    conditioning: NonNegative[float] = 0.01
    identity: NonNegative[float] = 0.1
    circumradius: Positive[float] = 0.2
    weight: Positive[float] = 15.0
    funnel: NonNegative[float] = 18.0
    onset: NonNegative[float] = 0.6
    inner: Positive[float] = 1.0
    outer: Positive[float] = 2.2
    lead: NonNegative[float] = 0.7
    posture: NonNegative[float] = 0.003

    def __post_init__(self):
        for name in ("inner", "onset"):
            if self.outer <= (radius := getattr(self, name)):
                raise ConfigurationError(
                    f"flow.outer is {self.outer!r}, expected more than flow.{name}, {radius!r}: set that as well."
                )


@settings("policy")
class PolicySettings:
    """Gains of the learned policy: cruise `speed`, m/s; `damping_rate`, 1/s; and by name, where they are not to
    be as the leaf has them, `joint_damping` of `Damping` on all joints and `joint_limit` of `JointLimit`. `tempo`:
    "constant", at the cruise speed, or as "demonstrated", when the speed is found and not set; only by a flow."""

    tempo: Tempo = "constant"
    speed: Positive[float] = 0.2
    damping_rate: Positive[float] = 40.0
    joint_damping: Mapping[str, float] = field(default_factory=dict, hash=False)
    joint_limit: Mapping[str, float] = field(default_factory=dict, hash=False)

    def __post_init__(self):
        UnknownNameError.check("tempo", self.tempo, get_args(Tempo))
        set_field(self, "joint_damping", {"weight": 2e-3, "damping_rate": 10.0} | dict(self.joint_damping))
        for gains, leaf, given in ((self.joint_damping, Damping, {}), (self.joint_limit, JointLimit, _SOME_RANGE)):
            known = [f.name for f in fields(leaf) if f.name not in given and not f.metadata.get("static")]
            for name in gains:
                UnknownNameError.check(f"gain of {leaf.__name__}", name, known)
            leaf(**given, **gains)


@dataclass(frozen=True)
class Configuration:
    """Everything that `learn` needs besides the demonstrations.

    `name` of the skill; `subtasks`, its control points, or one pose or orientation of a hand; `robot`, "panda" or the
    path of an MJCF or URDF file; `recording`, what the files of demonstrations leave open; `poses`, how the robot
    follows them where they have no joints; `fixed_joints`, joints of that file that stay at a value;
    `base`, the frame of the robot in which object poses were recorded; `object`, the tracked object whose frame the
    skill lives in, empty for the axes of `base` at the mean final position of the first control point; `seed`, of all
    that is random; `method`, "flow", "paper" or "auto", see `learn`; `preprocessing`, `target`, `flow`, `potential`,
    `metric` and `policy`, the settings of each step.

    **Raises** `ConfigurationError` for values that make no sense.
    """

    name: str
    subtasks: tuple[Subtask, ...]
    robot: str = "panda"
    fixed_joints: Mapping[str, float] = field(default_factory=dict, hash=False)
    base: str = "world"
    object: str = ""
    seed: int = 0
    method: Method = "auto"
    recording: RecordingSettings = RecordingSettings()
    poses: PoseSettings = PoseSettings()
    preprocessing: PreprocessingSettings = PreprocessingSettings()
    target: TargetSettings = TargetSettings()
    flow: FlowSettings = FlowSettings()
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
        UnknownNameError.check("method", self.method, get_args(Method))
        what = "an orientation" if self.of_turn else "a pose"
        if self.of_hand and len(names) > 1:
            raise ConfigurationError(
                f"subtasks {names} have {what} among them, which says all of a hand: leave the others out, or give "
                'three control points on that frame instead (kind = "points").'
            )
        if self.of_hand and self.method == "paper":
            raise ConfigurationError(
                f"subtask {names[0]!r} is {what}, of which method 'paper' knows nothing: set method to 'auto' or "
                "'flow', or give three control points instead."
            )
        if self.method == "paper" and self.policy.tempo != "constant":
            raise ConfigurationError(
                f"policy.tempo is {self.policy.tempo!r} and method 'paper', which knows one speed only. Set method to "
                "'flow', or policy.tempo to 'constant'."
            )
        if self.seed < 0:
            raise ConfigurationError(f"seed is {self.seed!r}, expected 0 or more.")
        if self.robot == "panda" and self.fixed_joints:
            raise ConfigurationError(
                f"fixed_joints is {dict(self.fixed_joints)!r}, but the built-in Panda has none to fix: its fingers are."
            )

    @property
    def of_hand(self) -> bool:
        """Whether a subtask is a whole hand: its pose, or how it is turned."""
        return any(subtask.kind != "points" for subtask in self.subtasks)

    @property
    def of_turn(self) -> bool:
        """Whether a subtask is how a hand is turned alone."""
        return any(subtask.kind == "orientation" for subtask in self.subtasks)

    @property
    def followed(self) -> PoseSettings:
        """`poses` with the frame that follows demonstrations without joints: if it names none, that of the subtasks, if
        they are all on one."""
        frames = list(dict.fromkeys(subtask.frame for subtask in self.subtasks))
        return self.poses if self.poses.frame or len(frames) > 1 else replace(self.poses, frame=frames[0])

    def load_robot(self) -> Robot:
        """The built-in Panda, or the robot of the MJCF or URDF file that is named. **Raises** as `load_robot`."""
        return panda() if self.robot == "panda" else load_robot(self.robot, fixed=self.fixed_joints)
