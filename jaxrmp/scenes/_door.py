"""A cabinet whose door stands open; the hand comes from inside it, round the door's free edge, to its handle.

Where everything stands follows from the demonstrations, in the tracked handle's frame. Over six recorded and six
synthetic ones, the gripper's centre ends at (0.04, 0.02, 0.04) m on average, the hand pointing along (-0.51, 0.86, 0),
the fingers side by side across that: so this is the direction in which the handle, a vertical bar between the fingers,
is before the hand, and the normal of the door. The tips that went furthest end 3.1 cm beyond that mean; the bar is
5.5 cm beyond it, the door 3.5 cm behind the bar. The demonstrations pass the door with 5 cm or more between it and all
of the arm, and move inside the cabinet within x -0.65 to -0.11, z -0.04 to 0.30 m; its walls leave 15 cm around that,
so that the cabinet can be moved by 10 cm and 15 degrees around an arm that stays where it is.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ._parts import LIGHT_WOOD, METAL, WOOD, add_bar, add_body, add_box, before_panda, moved, on_panda, pose_or, upright
from ._scene import Plotted, Scene

APPROACH = np.array([-0.506, 0.862, 0.0]) / np.hypot(0.506, 0.862)
"""From the outside to the door, in the object's frame."""
_STANDOFF = np.array([0.042, 0.020, 0.040])  # where the gripper's centre ends, m
_TO_BAR, _TO_DOOR = 0.055, 0.09  # along APPROACH, m
_TO_EDGE, _TO_HINGE = 0.045, 0.36  # from the bar along the door, m
_POSE, _YAW = np.array([0.017, -0.430, 0.762]), float(np.radians(-127.5))  # as recorded, in the base, m and rad

OBJECT_SPREAD = 0.10, float(np.radians(15.0))
"""How far the door is moved, m, and turned about the vertical, rad, at most."""


@dataclass(frozen=True, eq=False)
class Door(Scene):
    """The task is done when the hand rests where the demonstrations left it; the door's pose varies."""

    joint: str = "door_hinge"
    plotted: Plotted | None = Plotted("door turned (degrees)", float(np.degrees(1.0)))
    tracked: str = "door_handle"
    goal: str = "at the standoff pose"
    speed: float = 0.02

    def vary(self, trial: Any, rng: np.random.Generator, shown: Any) -> Any:
        direction = rng.normal(size=3)
        offset = OBJECT_SPREAD[0] * rng.uniform() ** (1 / 3) * direction / np.linalg.norm(direction)
        T = moved(trial.T_world_object, offset, rng.uniform(-OBJECT_SPREAD[1], OBJECT_SPREAD[1]))
        return trial._replace(T_world_object=T)


def door(T_world_object: np.ndarray | None = None) -> Door:
    """The Panda before an open cabinet door; the object is at `T_world_object` [4, 4], default as recorded."""
    T = pose_or(T_world_object, _POSE, _YAW)
    spec, thing = before_panda(T, [-1.15, -0.95, 0.5], [0.15, 0.1, -0.1])
    # The door, on its hinge: 0 rad is where it stood when shown.
    along = np.array([APPROACH[1], -APPROACH[0], 0.0])  # from the free edge to the hinge
    hinge = _STANDOFF + (_TO_DOOR + 0.01) * APPROACH + _TO_HINGE * along
    # x points from the hinge along the door to its free edge, y (z up) to the outside.
    door = add_body(thing, "door", hinge, upright(-along))
    resists = {"frictionloss": 0.5, "damping": 0.2}
    hinge = {"name": "door_hinge", "type": 3, "axis": [0.0, 0.0, 1.0]}  # mjJNT_HINGE
    door.add_joint(**hinge, range=[-0.5, 1.8], limited=True, **resists)
    half = 0.5 * (_TO_HINGE + _TO_EDGE)
    add_box(door, "door_panel", [half, 0.0, -0.05], [half, 0.01, 0.3], LIGHT_WOOD, mass=3.0)
    bar = np.array([_TO_HINGE, _TO_DOOR + 0.01 - _TO_BAR, 0.0])
    add_bar(door, "door_handle", [bar - [0.0, 0.0, 0.07], bar + [0.0, 0.0, 0.07]], 0.008, METAL, mass=0.2)
    for side in (-1.0, 1.0):
        center = [bar[0], 0.5 * (bar[1] + 0.01), 0.06 * side]
        name = "door_post_low" if side < 0 else "door_post_high"
        add_box(door, name, center, [0.006, 0.5 * (bar[1] - 0.01), 0.006], METAL, mass=0.02, touches=False)
    # The cabinet, fixed in the object's frame: its opening is the plane y = 0.28, from the hinge to the far side.
    cabinet = add_body(thing, "cabinet", [-0.345, 0.6, 0.0])
    add_box(cabinet, "cabinet_bottom", [0.0, 0.0, -0.36], [0.68, 0.3, 0.01], WOOD)
    add_box(cabinet, "cabinet_top", [0.0, 0.0, 0.52], [0.68, 0.3, 0.01], WOOD)
    add_box(cabinet, "cabinet_back", [0.0, 0.31, 0.08], [0.68, 0.01, 0.45], WOOD)
    add_box(cabinet, "cabinet_left", [-0.69, 0.0, 0.08], [0.01, 0.3, 0.45], WOOD)
    add_box(cabinet, "cabinet_right", [0.69, 0.0, 0.08], [0.01, 0.3, 0.45], WOOD)
    return Door("door", spec, T_world_object=T, **on_panda())
