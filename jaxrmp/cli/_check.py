"""`jaxrmp check`: what is read of a file, what is left out of it and why, and what looks wrong."""

import argparse
import contextlib
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import ConfigurationError, FileWarning, JaxrmpError, UnsafeFileWarning
from ..io import load_lula, read_xrdf
from ..kinematics import Robot, hand_frame, load_robot, panda
from ..learning import (
    DemonstrationSet,
    Preprocessed,
    RecordingSettings,
    control_points,
    families,
    fit_to_robot,
    in_frame,
    is_paths,
    is_poses,
    load_configuration,
    load_demonstrations,
    load_paths,
    load_poses,
    load_skill,
    own_clearance,
    prepare,
    preprocess,
)
from ..sequences import load_sequence
from ..world import RobotSpheres, own_self_pairs, own_spheres
from ._output import write_json
from ._sources import RECORDED, find_demonstrations

_LONG = 0.05  # m, from which on a link without geometry is worth a word
_HAND = 0.1 * (np.eye(3) - 1 / 3)  # m, points of a hand that show its turn
_KINDS = {
    "points": "{offset} in {frame}",
    "pose": "pose at {offset} in {frame}",
    "orientation": "orientation of {frame}, wherever it is",
}
_RANK = {"error": 0, "unsafe": 1, "note": 2}


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    kind, report = _kind(arguments.file)
    found = _Findings()
    with found.kept():
        report(arguments, found)
    content = {
        "file": str(arguments.file),
        "kind": kind,
        "safe": not found.unsafe,
        "read": found.read,
        "findings": found.found,
    }
    if arguments.json:
        write_json(content, arguments.json)
    print(_text(content))
    if found.unsafe:
        raise ConfigurationError(f"{arguments.file}: {found.unsafe} of the findings above must be mended before use.")


class _Findings:
    """What was `read`, and what was `found` wrong."""

    def __init__(self):
        self.read: dict[str, Any] = {}
        self.found: list[dict[str, str]] = []

    def add(self, severity: str, what: str) -> None:
        if all(finding["what"] != what for finding in self.found):
            self.found.append({"severity": severity, "what": what})
            self.found.sort(key=lambda finding: _RANK[finding["severity"]])

    @contextlib.contextmanager
    def kept(self) -> Iterator[None]:
        """Around what may warn or fail: warnings and typed errors become findings."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                yield
            except JaxrmpError as error:
                self.add("error", str(error))
        for warning in caught:
            if issubclass(warning.category, FileWarning) or warning.category is UserWarning:
                unsafe = issubclass(warning.category, UnsafeFileWarning)
                self.add("unsafe" if unsafe else "note", str(warning.message))

    def attempt(self, action: Callable[[], Any]) -> Any:
        """What `action` gives, None where it fails."""
        value = None
        with self.kept():
            value = action()
        return value

    @property
    def unsafe(self) -> int:
        return sum(finding["severity"] != "note" for finding in self.found)


def _kind(file: Path) -> tuple[str, Callable]:
    if is_poses(file):
        return "poses of a hand", _poses
    if is_paths(file):
        return "paths in the plane", _paths
    if file.is_dir():
        return "demonstrations", _demonstrations
    if file.suffix == ".toml" and file.is_file() and re.search(rb"^file *=", file.read_bytes(), re.MULTILINE):
        return "robot", _robot_file
    if file.suffix == ".toml" and file.is_file() and re.search(rb"^\[\[ *state *\]\]", file.read_bytes(), re.MULTILINE):
        return "sequence", _sequence
    recorded = dict.fromkeys((".hdf5", ".h5", ".bag", ".mcap", ".db3"), ("demonstrations", _demonstrations))
    kinds = {".toml": ("configuration", _configuration), ".npz": ("skill", _skill)}
    lula = dict.fromkeys((".xrdf", ".yaml", ".yml"), ("robot description (XRDF)", _xrdf))
    if (
        file.suffix.lower() != ".xrdf"
        and file.is_file()
        and re.search(rb"^rmp_params *:", file.read_bytes(), re.MULTILINE)
    ):
        raise ConfigurationError(
            f"{file} is an RMPflow configuration, which is checked with its robot: jaxrmp check FILE.xrdf --robot URDF "
            f"--rmpflow {file}."
        )
    return (kinds | lula | recorded).get(file.suffix.lower(), ("robot", _robot_file))


def _robot_file(arguments: argparse.Namespace, found: _Findings) -> None:
    robot = found.attempt(lambda: load_robot(arguments.file))
    if robot is not None:
        _robot(robot, found)


def _robot(robot: Robot, found: _Findings, spheres: RobotSpheres | None = None) -> None:
    """Joints and limits, hand, and what covers its links: its own geometry, unless there are `spheres`."""
    joints = {joint.name: joint for joint in robot.model.joints}
    limits = zip(robot.lower, robot.upper, robot.velocity_limit, strict=True)
    found.read |= {
        "robot": robot.name,
        "joints": [
            {"name": name, "kind": joints[name].kind, "lower": float(a), "upper": float(b), "velocity": float(v)}
            for name, (a, b, v) in zip(robot.joint_names, limits, strict=True)
        ],
        "following or locked joints": [name for name in joints if name not in robot.joint_names],
        "frames": list(robot.frame_names),
        "hand": hand_frame(robot),
        "spheres": None,
        "links without spheres": None,
        "pairs of spheres that keep apart": None,
    }
    if unknown := [name for name, v in zip(robot.joint_names, robot.velocity_limit, strict=True) if not np.isfinite(v)]:
        found.add("note", f"no velocity limit is known of {', '.join(unknown)}: policies do not bound their speed.")
    covered = spheres or found.attempt(lambda: own_spheres(robot))
    if covered is None:
        found.add("unsafe", "no sphere covers the robot: policies avoid neither obstacles nor the arm itself.")
        return
    moved = [robot.model.bodies[j.body].name for j in robot.model.joints if j.coordinate >= 0]
    found.read["spheres"] = {"number": covered.size, "stick out by, m": float(covered.coverage_error)}
    found.read["links without spheres"] = [name for name in dict.fromkeys(moved) if name not in covered.frames]
    bare = found.read["links without spheres"]
    if long := [name for name in bare if _length(robot, name) > _LONG]:
        found.add("unsafe", f"links {', '.join(long)} have length and no geometry: nothing keeps them off obstacles.")
    if spheres is None:
        found.read["pairs of spheres that keep apart"] = len(own_self_pairs(robot, covered))


def _length(robot: Robot, link: str) -> float:
    """How far from a link's own origin anything hangs on it, m."""
    at = robot.frame_index(link)
    hung = [body.position for body in robot.model.bodies if body.parent == at]
    hung += [frame.position for frame in robot.model.frames if frame.body == at]
    return max((float(np.linalg.norm(position)) for position in hung), default=0.0)


def _configuration(arguments: argparse.Namespace, found: _Findings) -> None:
    configuration = load_configuration(arguments.file)
    found.read |= {"name": configuration.name, "object": configuration.object or "none"}
    found.read["subtasks"] = [
        f"{s.name}: {_KINDS[s.kind].format(offset=s.offset, frame=s.frame)}" for s in configuration.subtasks
    ]
    robot = found.attempt(configuration.load_robot)
    if robot is None:
        return
    _robot(robot, found)
    for subtask in configuration.subtasks:
        found.attempt(lambda frame=subtask.frame: robot.frame_index(frame))
    if arguments.demos:
        recorded = lambda: find_demonstrations(arguments.demos, configuration, robot)  # noqa: E731
        prepared = found.attempt(lambda: prepare(configuration, robot, recorded()))
        _pauses(prepared.joints if prepared else None, found)
        _agreement(prepared.points if prepared else None, found)
        if prepared is not None:
            _clear_of_itself(robot, prepared.joints.q, found, bool(configuration.poses.start))


def _pauses(joints: Preprocessed | None, found: _Findings) -> None:
    for k, report in enumerate(joints.reports if joints else ()):
        if report.paused:
            found.add("note", f"demonstration {k} pauses: {report.paused}. What is learned goes on instead.")


def _sequence(arguments: argparse.Namespace, found: _Findings) -> None:
    described = load_sequence(arguments.file)
    found.read = {"states": [str(state["name"]) for state in described.content["state"]]}
    found.read["skills"] = [skill.configuration.name for skill in described.skills if skill is not None]
    first, given = described.first_skill, arguments.robot
    if given is None and first is None:
        found.add("note", "its frames and its start were not checked: give the arm with --robot FILE.")
        return
    named = (lambda: _named_robot(given)) if given or first is None else lambda: first.load_robot(None)
    robot = found.attempt(named)
    if robot is not None:
        described.check_robot(robot)
        found.read["fits the robot"] = robot.name
    found.add("note", "what a scene has was not checked, such as its object: jaxrmp run does that before it begins.")


def _named_robot(name: str) -> Robot:
    return panda() if name == "panda" else load_robot(name)


def _skill(arguments: argparse.Namespace, found: _Findings) -> None:
    skill = load_skill(arguments.file)
    found.read |= {
        "name": skill.configuration.name,
        "subtasks": [f"{name} at {frame}" for name, frame in zip(skill.subtasks, skill.frames, strict=True)],
        "object": skill.configuration.object or "none",
        "learned from": skill.source,
    }
    robot = found.attempt(lambda: skill.load_robot(arguments.robot))
    if robot is not None:
        _robot(robot, found)


def _demonstrations(arguments: argparse.Namespace, found: _Findings) -> None:
    robot = _named_robot(arguments.robot) if arguments.robot else None
    demonstrations = load_demonstrations(arguments.file, _recording(arguments), robot)
    found.read |= {
        "layout": demonstrations.layout,
        "units": demonstrations.units,
        "demonstrations": [
            {"samples": len(d.time), "seconds": float(d.time[-1] - d.time[0]), "objects": ", ".join(d.poses)}
            for d in demonstrations
        ],
        "columns": list(demonstrations.joint_names),
    }
    if robot is not None:
        fitted = found.attempt(lambda: fit_to_robot(demonstrations, robot))
        found.read["fit the robot"] = robot.name if fitted is not None else None
        _agreement(found.attempt(lambda: _hand_points(robot, fitted, found)) if fitted is not None else None, found)
    else:
        found.read["fit the robot"] = found.read["ways to go"] = None
        found.add("note", "angles, units, columns and agreement were not checked: give the arm with --robot FILE.")


def _hand_points(robot: Robot, demonstrations: DemonstrationSet, found: _Findings) -> list[np.ndarray]:
    """Points of the hand [T, K, 3] in each, seen from the object if there is one, m."""
    frames = (hand_frame(robot),) * len(_HAND)
    joints = preprocess(demonstrations)
    _pauses(joints, found)
    _clear_of_itself(robot, joints.q, found)
    points = [control_points(robot, frames, _HAND, q) for q in joints.q]
    if len(demonstrations.object_names) == 1:
        (name,) = demonstrations.object_names
        points = [in_frame(path, d.pose(name)) for path, d in zip(points, demonstrations, strict=True)]
    return points


def _clear_of_itself(robot: Robot, ways: Sequence[np.ndarray], found: _Findings, of_poses: bool = False) -> None:
    clearance = found.attempt(lambda: own_clearance(robot, ways, of_poses))
    found.read["the robot and itself"] = str(clearance)


def _agreement(points: Sequence[np.ndarray] | None, found: _Findings) -> None:
    agreement = families(points) if points else None
    found.read["ways to go"] = len(agreement.groups) + len(agreement.odd) if agreement else None
    if agreement and not agreement.agree:
        found.add("note", str(agreement))


def _poses(arguments: argparse.Namespace, found: _Findings) -> None:
    demonstrations = load_poses(arguments.file, _recording(arguments))
    found.read |= {
        "layout": demonstrations.layout,
        "demonstrations": [
            {
                "samples": len(d.time),
                "seconds": float(d.time[-1] - d.time[0]),
                "path, m": float(np.linalg.norm(np.diff(d.position, axis=0), axis=1).sum()),
                "objects": ", ".join(d.poses),
            }
            for d in demonstrations
        ],
    }


def _paths(arguments: argparse.Namespace, found: _Findings) -> None:
    paths = load_paths(arguments.file)
    found.read["paths"] = [
        {"samples": len(p), "length": float(np.linalg.norm(np.diff(p, axis=0), axis=1).sum())} for p in paths
    ]


def _recording(arguments: argparse.Namespace) -> RecordingSettings:
    return RecordingSettings(**{key: value for key in RECORDED if (value := getattr(arguments, key))})


def _xrdf(arguments: argparse.Namespace, found: _Findings) -> None:
    description = read_xrdf(arguments.file)
    found.read |= {
        "joints of the file": description.joint_names.texts(),
        "tool frames": list(description.tool_frames),
        "spheres of the file": description.world_spheres.size,
        "modifiers": len(description.modifiers),
    }
    if not arguments.robot or not arguments.rmpflow:
        found.add("note", "not checked against its robot: give --robot URDF and --rmpflow YAML.")
        return
    policy = found.attempt(lambda: load_lula(arguments.robot, arguments.file, arguments.rmpflow))
    if policy is not None:
        _robot(policy.robot, found, policy.spheres)
        found.read["set, and no policy acts on it"] = list(policy.inactive)


def _text(content: dict[str, Any]) -> str:
    lines = [f"{content['file']}: {content['kind']}"]
    for name, value in content["read"].items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            rows = [list(value[0]), *([_cell(v) for v in row.values()] for row in value)]
            widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
            lines.append(name)
            lines += ["  " + "  ".join(c.ljust(w) for c, w in zip(r, widths, strict=True)).rstrip() for r in rows]
        else:
            lines.append(f"{name}: {_cell(value)}")
    lines += [f"{finding['severity'].upper()}: {finding['what']}" for finding in content["findings"]]
    return "\n".join([*lines, "" if content["findings"] else "nothing looks wrong"]).rstrip()


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}" if np.isfinite(value) else "none"
    if isinstance(value, dict):
        return ", ".join(f"{name} {_cell(v)}" for name, v in value.items())
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    return "not checked" if value is None else str(value)
