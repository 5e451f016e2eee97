"""Flattened states of MuJoCo (time, positions, velocities) by the joints of their model's text."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._errors import DemonstrationError, UnknownNameError
from .._rotations import pose, rotation_of_quaternion

_JOINTS = ("joint", "freejoint")
_MAKE_BODIES = ("composite", "flexcomp", "replicate", "attach", "include")
_TURNS = ("euler", "axisangle", "xyaxes", "zaxis")
_SIZE = {"free": 7, "ball": 4, "hinge": 1, "slide": 1}
_SPEEDS = {"free": 6, "ball": 3, "hinge": 1, "slide": 1}


@dataclass(frozen=True)
class MujocoStates:
    """`time` [T], s; `qpos` [T, nq]; `joints`, by name their kind, first column and body; `bases`, by robot the pose of
    its base in the world, None where it is not known; `where` they are from.

    The model is not compiled: its meshes need not be there.
    """

    time: np.ndarray
    qpos: np.ndarray
    joints: dict[str, tuple[str, int, str]]
    bases: dict[str, np.ndarray | None]
    where: str

    @classmethod
    def read(cls, model: str | bytes, states: Any, where: str) -> "MujocoStates":
        """Of the text of a `model` and a table of `states`. **Raises** `DemonstrationError` if they do not fit."""
        try:
            root = ET.fromstring(model)
        except ET.ParseError as error:
            raise DemonstrationError(f"{where}: its model_file is no XML: {error}.") from error
        joints: dict[str, tuple[str, int, str]] = {}
        bases: dict[str, np.ndarray | None] = {}
        size = speeds = 0

        def walk(body: ET.Element, T_world_body: np.ndarray | None) -> None:
            nonlocal size, speeds
            inside = list(_inside(body, T_world_body))
            name = body.get("name", "")
            if moves := any(element.tag in _JOINTS for element, _ in inside):
                T_world_body = None
            if name.endswith("_base"):
                bases[name.removesuffix("_base")] = T_world_body
            for element, T in inside:
                if element.tag in _JOINTS:
                    kind = "free" if element.tag == "freejoint" else element.get("type", "hinge")
                    joints[element.get("name", f"joint {size}")] = (kind, size, name)
                    size += _SIZE[kind]
                    speeds += _SPEEDS[kind]
                elif element.tag == "body":
                    walk(element, _moved(None if moves else T, element))
                elif element.tag in _MAKE_BODIES:
                    raise DemonstrationError(
                        f"{where}: its model has a <{element.tag}>, whose joints are not known before it is compiled. "
                        "Save the compiled model's own text as model_file (mujoco.mj_saveLastXML)."
                    )

        for world in root.findall("worldbody"):
            walk(world, np.eye(4))
        table = np.asarray(states[()], np.float64)
        width, more = 1 + size + speeds, sum(map(_has_state, root.iterfind("actuator/*")))
        if table.ndim != 2 or table.shape[1] not in (width, width + more):
            raise DemonstrationError(
                f"{where}: states of shape {table.shape} are not of the model, whose {size} positions and {speeds} "
                f"velocities take {width} columns with the time."
            )
        return cls(table[:, 0], table[:, 1 : 1 + size], joints, bases, where)

    @property
    def robots(self) -> dict[str, tuple[str, ...]]:
        """By the prefix of their names (robot0) the hinges and slides of each robot."""
        found: dict[str, tuple[str, ...]] = {}
        for name, (kind, _, _) in self.joints.items():
            if name.startswith("robot") and kind in ("hinge", "slide"):
                prefix = name.split("_")[0]
                found[prefix] = (*found.get(prefix, ()), name)
        return found

    def joint_positions(self, robot: str) -> np.ndarray:
        """Positions [T, n] of the joints of the `robot` that is named."""
        UnknownNameError.check(f"robot in {self.where}", robot, self.robots)
        return self.qpos[:, [self.joints[name][1] for name in self.robots[robot]]]

    def object_pose(self, name: str, group: str) -> np.ndarray:
        """Poses [T, 4, 4] of a free body (or joint) in the frame of the base of the robot that `group` names."""
        at = {
            given: first
            for joint, (kind, first, body) in self.joints.items()
            if kind == "free"
            for given in (body, joint)
        }
        UnknownNameError.check(f"free body in {self.where}", name, at)
        p_and_q = self.qpos[:, at[name] : at[name] + 7]
        T_world_object = pose(p_and_q[:, :3], rotation_of_quaternion(p_and_q[:, 3:]))
        robot = next((known for known in self.bases if known in group), "robot0")
        UnknownNameError.check(f"base of a robot in {self.where}", robot, self.bases)
        T_world_base = self.bases[robot]
        if T_world_base is None:
            raise DemonstrationError(
                f"{self.where}: the pose of {name!r} is not known in the frame of {robot}_base: that body moves, or is "
                f"turned by {', '.join(_TURNS)}, and quat alone is read."
            )
        return np.linalg.inv(T_world_base) @ T_world_object


def _inside(body: ET.Element, T_world_body: np.ndarray | None) -> Iterator[tuple[ET.Element, np.ndarray | None]]:
    """What a body holds, also in frames, and the pose of what holds it."""
    for element in body:
        if element.tag == "frame":
            yield from _inside(element, _moved(T_world_body, element))
        else:
            yield element, T_world_body


def _moved(T: np.ndarray | None, element: ET.Element) -> np.ndarray | None:
    return None if T is None or any(key in element.attrib for key in _TURNS) else T @ _placed(element)


def _has_state(actuator: ET.Element) -> bool:
    return (
        actuator.tag in ("intvelocity", "cylinder", "muscle", "plugin")
        or actuator.get("dyntype", "none") != "none"
        or "timeconst" in actuator.attrib
    )


def _placed(body: ET.Element) -> np.ndarray:
    numbers = [
        np.array((body.get(key) or default).split(), float) for key, default in (("pos", "0 0 0"), ("quat", "1 0 0 0"))
    ]
    return pose(numbers[0], rotation_of_quaternion(numbers[1]))
