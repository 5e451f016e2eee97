"""Sequences as TOML files, with every mistake named by its key and its line."""

import re
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .._errors import ConfigurationError, JaxrmpError, UnknownNameError
from .._rotations import pose, rotation_of_quaternion, rotation_of_rpy
from ..kinematics import Robot
from ..learning import Skill, load_skill
from ..scenes import Scene
from ..scenes._gripper import check_width
from ._sequence import END, RELATIVE_TO, After, Arrived, GripperMove, Sequence, State
from ._states import perform, reach

_TOP = ("limit", "start", "state")
_STATE = (
    *("name", "skill", "reach", "relative_to", "position", "quaternion_wxyz", "rpy_degrees"),
    *("arrived", "seconds", "timeout", "on_timeout", "then", "gripper", "gripper_seconds"),
)
_ARRIVED = ("position", "turn_degrees", "speed", "hold")


class SequenceFile(NamedTuple):
    """What the file at `path` says: its `text`, the `content` by key, and the `skills` of its states, None for a state
    without one. `on(scene, q)` makes it a `Sequence`."""

    path: Path
    text: str
    content: dict[str, Any]
    skills: tuple[Skill | None, ...]

    @property
    def first_skill(self) -> Skill | None:
        """The first of its skills: where its object was demonstrated is where a scene has it."""
        return next((skill for skill in self.skills if skill is not None), None)

    @property
    def start(self) -> np.ndarray | None:
        """Where it says that the arm starts [n], rad; None if it does not."""
        return None if "start" not in self.content else np.asarray(self.content["start"], float)

    def check_robot(self, robot: Robot) -> None:
        """**Raises** `ConfigurationError`, with the line of the file, for a start or a frame that is none of the
        `robot`'s, or a skill that was learned on another."""
        if self.start is not None and self.start.shape != (robot.num_joints,):
            raise ConfigurationError(
                f"{self._at(None, 'start')}: start has {self.start.size} numbers, and {robot.name!r} has "
                f"{robot.num_joints} joints."
            )
        for k, (entry, skill) in enumerate(zip(self.content["state"], self.skills, strict=True)):
            key = "skill" if skill is not None else "reach"
            try:
                if skill is not None:
                    skill.check_robot(robot)
                else:
                    robot.frame_index(entry["reach"])
            except JaxrmpError as error:
                raise ConfigurationError(f"{self._at(k, key)}: {error}") from error

    def on(self, scene: Scene, rest: Any) -> Sequence:
        """The sequence on the robot of a `scene`, reaching with elbows as at `rest` [n] as far as that is free.

        **Raises** `ConfigurationError` and its kind, each with the line of the file, for a state that does not fit the
        robot or the scene.
        """
        self.check_robot(scene.robot)
        states = []
        for k, (entry, skill) in enumerate(zip(self.content["state"], self.skills, strict=True)):
            try:
                states.append(_state(entry, skill, scene, rest))
            except JaxrmpError as error:
                key = "skill" if skill is not None else "reach"
                raise ConfigurationError(f"{self._at(k, key)}: {error}") from error
        try:
            sequence = Sequence(tuple(states), self.content.get("limit", 120.0))
        except JaxrmpError as error:
            raise ConfigurationError(f"{self._at(None, 'limit')}: {error}") from error
        return sequence

    def _at(self, state: int | None, key: str) -> str:
        return _where(self.path, self.text, state, key)


def load_sequence(path: str | Path) -> SequenceFile:
    """Read the sequence at `path`, and the skills that it names, which are looked for from its folder, and then from
    where the program runs.

    ```toml
    limit = 60.0                     # seconds in all, by default 120
    start = [0, -0.8, 0, -2.4, 0, 1.6, 0.8]  # rad; by default where the first skill's demonstrations start

    [[state]]
    name = "before"
    reach = "panda_hand_tcp"         # a frame of the robot; or skill = "FILE"
    relative_to = "object"           # or "world"
    position = [-0.2, 0.1, 0.1]      # m
    rpy_degrees = [180, 0, 0]        # or quaternion_wxyz; without either, its turn is free
    arrived = { position = 0.01, turn_degrees = 10, speed = 0.02, hold = 0.2 }  # m, degrees, m/s, s; or seconds = 3
    timeout = 20                     # s
    on_timeout = "away"              # a state, or "end"; without, the sequence fails
    gripper = "close"                # or "open", or m between the fingers: once it has arrived
    gripper_seconds = 1.0
    then = "away"                    # by default the state after it
    ```

    **Raises** `ConfigurationError` with the file's line for a key, a type or a number that is not right, a file that
    cannot be read, or a state that another names and that is not there; `SkillFileError`.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
        content = tomllib.loads(text)
    except OSError as error:
        raise ConfigurationError(f"cannot read sequence {str(path)!r}: {error.strerror}.") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"sequence {str(path)!r} is no valid TOML: {error}.") from error
    states = content.get("state")
    if not isinstance(states, list) or not states or not all(isinstance(entry, dict) for entry in states):
        raise ConfigurationError(f"sequence {str(path)!r} has no states: write [[state]], once for each.")
    _check(path, text, None, lambda key: _top(key, content), content)
    names = [entry.get("name") for entry in states]
    for k, entry in enumerate(states):
        _check(path, text, k, lambda key, entry=entry: _entry(key, entry, names), entry)
        for key in ("name", "arrived"):  # what is missing, and what does not go together
            _check(path, text, k, lambda key, entry=entry: _together(key, entry), {key: None})
    return SequenceFile(path, text, content, tuple(_skill(path, text, k, entry) for k, entry in enumerate(states)))


def _check(path: Path, text: str, state: int | None, judged: Any, table: dict[str, Any]) -> None:
    """Judge every key of a table; what it raises is told with the key's line."""
    for key in table:
        try:
            judged(key)
        except JaxrmpError as error:
            raise ConfigurationError(f"{_where(path, text, state, key)}: {error}") from error


def _where(path: Path, text: str, state: int | None, key: str) -> str:
    """The file and the line of a key, or of the state that lacks it."""
    lines = text.splitlines()
    heads = [i for i, line in enumerate(lines) if re.match(r"\s*\[\[\s*state\s*\]\]", line)]
    first = 0 if state is None or state >= len(heads) else heads[state]
    last = next((i for i in heads if i > first), len(lines))
    pattern = re.compile(rf"\s*(?:\[state\.)?[\"']?{re.escape(key)}[\"']?\s*[=.\]]")
    found = next((i for i in range(first, last) if pattern.match(lines[i])), first)
    return f"{path}, line {found + 1}"


def _top(key: str, content: dict[str, Any]) -> None:
    UnknownNameError.check("key of a sequence", key, _TOP)
    if key == "limit":
        _number(key, content[key])
    if key == "start":
        _numbers(key, content[key], None)


def _entry(key: str, entry: dict[str, Any], names: list[Any]) -> None:
    UnknownNameError.check("key of a state", key, _STATE)
    value = entry[key]
    if key in ("name", "skill", "reach") and (not isinstance(value, str) or not value):
        raise ConfigurationError(f"{key} is {value!r}, expected a text.")
    if key == "name" and (value == END or names.count(value) > 1):
        raise ConfigurationError(f"name is {value!r}: expected each name once, and none {END!r}.")
    if key in ("then", "on_timeout"):
        UnknownNameError.check(f"state for {key}", value, [*(n for n in names if isinstance(n, str)), END])
    if key == "relative_to":
        UnknownNameError.check(key, value, RELATIVE_TO)
    if key in ("seconds", "timeout", "gripper_seconds"):
        _number(key, value)
    if key == "gripper":
        check_width(value)
    for name, count in (("position", 3), ("rpy_degrees", 3), ("quaternion_wxyz", 4)):
        if key == name:
            _numbers(key, value, count)
    if key == "quaternion_wxyz" and not np.linalg.norm(value) > 0:
        raise ConfigurationError(f"{key} is {value!r}, expected one that is not zero.")
    if key == "arrived":
        if not isinstance(value, dict):
            raise ConfigurationError(f"arrived is {value!r}, expected a table: {{ {', '.join(_ARRIVED)} }}.")
        for name, number in value.items():
            UnknownNameError.check("key of arrived", name, _ARRIVED)
            _number(f"arrived.{name}", number, zero=name == "hold")


def _together(key: str, entry: dict[str, Any]) -> None:
    if key == "name" and "name" not in entry:
        raise ConfigurationError("a state has no name.")
    name = entry["name"]
    if key == "name" and ("skill" in entry) == ("reach" in entry):
        raise ConfigurationError(f"state {name!r}: expected either skill or reach.")
    if key == "name" and "reach" in entry and "position" not in entry:
        raise ConfigurationError(f"state {name!r} reaches, and has no position.")
    goal = [k for k in ("relative_to", "position", "rpy_degrees", "quaternion_wxyz") if k in entry]
    if key == "name" and "skill" in entry and goal:
        raise ConfigurationError(f"state {name!r} is of a skill, which has its own goal: leave {', '.join(goal)} out.")
    if "rpy_degrees" in entry and "quaternion_wxyz" in entry:
        raise ConfigurationError(f"state {name!r}: expected one of rpy_degrees and quaternion_wxyz.")
    late = [k for k in ("arrived", "timeout", "on_timeout") if k in entry]
    if "seconds" in entry and late:
        raise ConfigurationError(f"state {name!r} is over after its seconds: leave {', '.join(late)} out.")
    if "gripper_seconds" in entry and "gripper" not in entry:
        raise ConfigurationError(f"state {name!r}: gripper_seconds without gripper.")


def _number(key: str, value: Any, zero: bool = False) -> None:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not (value >= 0 if zero else value > 0) or not np.isfinite(value):
        raise ConfigurationError(f"{key} is {value!r}, expected a {'' if zero else 'positive '}number.")


def _numbers(key: str, value: Any, count: int | None) -> None:
    numbers = isinstance(value, list) and all(isinstance(v, int | float) and not isinstance(v, bool) for v in value)
    if not numbers or not value or (count is not None and len(value) != count) or not np.isfinite(value).all():
        raise ConfigurationError(f"{key} is {value!r}, expected {count or 'a list of'} finite numbers.")


def _skill(path: Path, text: str, k: int, entry: dict[str, Any]) -> Skill | None:
    if "skill" not in entry:
        return None
    beside = path.parent / entry["skill"]
    try:
        return load_skill(beside if beside.is_file() else entry["skill"])
    except (JaxrmpError, OSError) as error:
        raise ConfigurationError(f"{_where(path, text, k, 'skill')}: {error}") from error


def _state(entry: dict[str, Any], skill: Skill | None, scene: Scene, rest: Any) -> State:
    """The state that an entry describes."""
    arrived = entry.get("arrived", {})
    turn = {"angle": float(np.radians(arrived["turn_degrees"]))} if "turn_degrees" in arrived else {}
    known = {key: value for key, value in arrived.items() if key != "turn_degrees"} | turn
    late = {name: entry[key] for key, name in (("timeout", "timeout"), ("on_timeout", "otherwise")) if key in entry}
    guard = After(entry["seconds"]) if "seconds" in entry else Arrived(**known, **late)
    gripper = GripperMove(entry["gripper"], entry.get("gripper_seconds", 1.0)) if "gripper" in entry else None
    settings = {"gripper": gripper, "then": entry.get("then")}
    if skill is not None:
        scene.check_object(skill.configuration.object, skill.configuration.name)
        T = None if skill.configuration.object else scene.T_world_object
        return perform(entry["name"], skill, scene.robot, guard, T_world_object=T, **settings)
    settings["relative_to"] = entry.get("relative_to", "object")
    R, turned = np.eye(3), True
    if "rpy_degrees" in entry:
        R = rotation_of_rpy(np.radians(entry["rpy_degrees"]))
    elif "quaternion_wxyz" in entry:
        R = rotation_of_quaternion(np.asarray(entry["quaternion_wxyz"], float))
    else:
        turned = False
    T = pose(np.asarray(entry["position"], float), R)
    return reach(entry["name"], scene.robot, entry["reach"], T, guard, turned=turned, rest=rest, **settings)
