"""What a skill is learned from and how: the content of a configuration file."""

import dataclasses
import tomllib
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .._errors import ConfigurationError, UnknownNameError
from ._preprocessing import PreprocessingSettings


@dataclass(frozen=True)
class Subtask:
    """One control point whose motion matters: `offset` [3], m, in the robot's frame `frame`."""

    name: str
    frame: str
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class TargetSettings:
    """`taper`, m: target speed falls as tanh(distance / taper). `end_tolerance`, m: how far apart ends may lie."""

    taper: float = 0.03
    end_tolerance: float = 0.08


@dataclass(frozen=True)
class PotentialSettings:
    """How the potential is fitted and its kernel width chosen; lengths in metres, see `choose_potential`."""

    widths: tuple[float, ...] = (0.02, 0.03, 0.04, 0.05, 0.06, 0.08)
    sharpness: float = 30.0
    regularization: float = 1e-4
    end_weight: float = 100.0
    basin_starts: int = 2000
    basin_margin: float = 0.3


@dataclass(frozen=True)
class MetricSettings:
    """The metric's network and training, see `train_metrics`. Every other sample is trained on, each with a copy
    displaced by normal noise of standard deviation `spread`, m, and the same target velocity, so that the field is
    smooth in a tube around the demonstrations."""

    hidden: tuple[int, ...] = (128, 64)
    activation: str = "relu"
    offset: float = 1e-3
    length_scale: float = 0.1
    loss: str = "smooth_l1"
    updates: int = 1000
    learning_rate: float = 0.005
    weight_decay: float = 3e-5
    spread: float = 0.01


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


@dataclass(frozen=True)
class Configuration:
    """Everything that `learn` needs besides the demonstrations.

    `name` of the skill; `subtasks`, its control points; `robot`, "panda" or the path of an MJCF or URDF file;
    `fixed_joints`, joints of that file that stay at a value; `object`, the tracked object whose frame the skill lives
    in, empty for the base axes at the mean final position of the first control point.

    **Raises** `ConfigurationError` for values that make no sense.
    """

    name: str
    subtasks: tuple[Subtask, ...]
    robot: str = "panda"
    fixed_joints: Mapping[str, float] = field(default_factory=dict, hash=False)
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
        for section, values in (("policy", self.policy), ("target", self.target)):
            for key, value in dataclasses.asdict(values).items():
                if not 0 < value < float("inf") and (section, key) != ("target", "taper"):
                    raise ConfigurationError(f"{section}.{key} is {value!r}, expected a positive number.")
        if not self.potential.widths or min(self.potential.widths) <= 0:
            raise ConfigurationError(f"potential.widths is {self.potential.widths!r}, expected positive lengths.")
        if self.metric.updates < 1 or self.metric.length_scale <= 0 or self.metric.offset <= 0:
            raise ConfigurationError("metric.updates, metric.length_scale and metric.offset must be positive.")


def load_configuration(path: str | Path, overrides: Mapping[str, Any] | None = None) -> Configuration:
    """Read a TOML configuration; `overrides` are values by dotted key, such as
    `{"metric.updates": 500, "subtasks.gripper.frame": "panda_hand"}`.

    **Raises** `ConfigurationError` if the file is missing or unreadable, or a value has the wrong type;
    `UnknownNameError` for a key that is not known.
    """
    try:
        content = tomllib.loads(Path(path).read_text())
    except OSError as error:
        raise ConfigurationError(f"cannot read configuration {str(path)!r}: {error.strerror}.") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"configuration {str(path)!r} is no valid TOML: {error}.") from error
    for key, value in (overrides or {}).items():
        *sections, last = key.split(".")
        table: Any = content
        for section in sections:
            table = _section(table, section, key)
        table[last] = value
    return configuration_from_dict(content)


def _section(table: dict[str, Any], section: str, key: str) -> dict[str, Any]:
    """The section of a table, made if need be; of a list of named tables, as `subtasks` is, a dict of them by name."""
    inner = table.setdefault(section, {})
    if isinstance(inner, list) and all(isinstance(entry, dict) for entry in inner):
        return _Named(inner)
    if not isinstance(inner, dict):
        raise ConfigurationError(f"{key!r} does not name a value: {section!r} is no section.")
    return inner


class _Named(dict):
    """A list of tables seen by their names."""

    def __init__(self, tables: list[dict[str, Any]]):
        super().__init__({str(table.get("name")): table for table in tables})

    def setdefault(self, key, default=None):
        if key not in self:
            raise UnknownNameError("subtask", key, self)
        return self[key]


def configuration_from_dict(content: Mapping[str, Any]) -> Configuration:
    """A `Configuration` from plain dictionaries, as in TOML or in a skill file. Raises as `load_configuration`."""
    return _build(Configuration, dict(content), "")


def _build(kind: Any, value: Any, where: str) -> Any:
    """Turn plain data into the annotated type `kind`, or say what does not fit."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if dataclasses.is_dataclass(kind):
        if not isinstance(value, Mapping):
            raise ConfigurationError(f"{where} is {value!r}, expected a section of keys.")
        types_of = typing.get_type_hints(kind)
        known = [f.name for f in dataclasses.fields(kind)]
        for key in value:
            if key not in known:
                raise UnknownNameError(f"configuration key in {where or 'the configuration'}", key, known)
        for f in dataclasses.fields(kind):
            required = f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
            if required and f.name not in value:
                raise ConfigurationError(f"{where + '.' if where else ''}{f.name} is missing.")
        prefix = f"{where}." if where else ""
        return kind(**{key: _build(types_of[key], v, prefix + key) for key, v in value.items()})  # type: ignore[operator]
    if origin is tuple and isinstance(value, list | tuple):
        if arguments[-1] is not Ellipsis and len(value) != len(arguments):
            raise ConfigurationError(f"{where} is {value!r}, expected {len(arguments)} entries.")
        kinds = [arguments[0]] * len(value) if arguments[-1] is Ellipsis else arguments
        return tuple(_build(k, v, f"{where}[{i}]") for i, (k, v) in enumerate(zip(kinds, value, strict=True)))
    if origin in (Mapping, dict) or kind is Mapping or getattr(origin, "__name__", "") == "Mapping":
        if isinstance(value, Mapping):
            return types.MappingProxyType({str(k): _build(arguments[1], v, f"{where}.{k}") for k, v in value.items()})
    elif origin is typing.Literal or (kind is str and isinstance(value, str)):
        return value
    elif kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    elif kind is int and isinstance(value, int) and not isinstance(value, bool):
        return value
    expected = getattr(kind, "__name__", str(kind))
    raise ConfigurationError(f"{where} is {value!r} ({type(value).__name__}), expected {expected}.")


def configuration_to_dict(configuration: Configuration) -> dict[str, Any]:
    """Plain dictionaries, lists, strings and numbers, fit for JSON; `configuration_from_dict` undoes it."""
    return {f.name: _plain(getattr(configuration, f.name)) for f in dataclasses.fields(configuration)}


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items()}
    return [_plain(v) for v in value] if isinstance(value, tuple | list) else value
