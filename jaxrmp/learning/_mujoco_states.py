"""Flattened states of MuJoCo (time, positions, velocities) by the joints of their model's text."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._errors import DemonstrationError, UnknownNameError
from .._rotations import pose, rotation_of_quaternion

_SIZE = {"free": 7, "ball": 4, "hinge": 1, "slide": 1}


@dataclass(frozen=True)
class MujocoStates:
    """`time` [T], s; `qpos` [T, nq]; `joints`, by name their kind, first column and body; `bases`, by robot the pose of
    its base in the world; `where` they are from. The model is not compiled: its meshes need not be there."""

    time: np.ndarray
    qpos: np.ndarray
    joints: dict[str, tuple[str, int, str]]
    bases: dict[str, np.ndarray]
    where: str

    @classmethod
    def read(cls, model: str | bytes, states: Any, where: str) -> "MujocoStates":
        """Of the text of a `model` and a table of `states`. **Raises** `DemonstrationError` if they do not fit."""
        try:
            world = ET.fromstring(model).find("worldbody")
        except ET.ParseError as error:
            raise DemonstrationError(f"{where}: its model_file is no XML: {error}.") from error
        joints: dict[str, tuple[str, int, str]] = {}
        bases: dict[str, np.ndarray] = {}
        size = 0

        def walk(body: ET.Element, T_world_body: np.ndarray) -> None:
            nonlocal size
            for element in body:
                if element.tag in ("joint", "freejoint"):
                    kind = "free" if element.tag == "freejoint" else element.get("type", "hinge")
                    joints[element.get("name", f"joint {size}")] = (kind, size, body.get("name", ""))
                    size += _SIZE[kind]
                elif element.tag == "body":
                    T = T_world_body @ _placed(element)
                    if element.get("name", "").endswith("_base"):
                        bases[element.get("name", "").removesuffix("_base")] = T
                    walk(element, T)

        if world is not None:
            walk(world, np.eye(4))
        table = np.asarray(states[()], np.float64)
        if table.ndim != 2 or table.shape[1] < 1 + size:
            raise DemonstrationError(
                f"{where}: states of shape {table.shape} do not hold the {size} positions of the model."
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
        return np.linalg.inv(self.bases[robot]) @ T_world_object


def _placed(body: ET.Element) -> np.ndarray:
    numbers = [
        np.array((body.get(key) or default).split(), float) for key, default in (("pos", "0 0 0"), ("quat", "1 0 0 0"))
    ]
    return pose(numbers[0], rotation_of_quaternion(numbers[1]))
