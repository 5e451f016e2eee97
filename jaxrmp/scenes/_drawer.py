"""A cabinet with a drawer that the hand pushes closed.

Where it stands follows from the demonstrations, in the object's frame (axes of the arm's base, origin at the mean end
of the gripper's centre). Over six recorded and six synthetic ones:

- The last 0.2 m of every path run along (0.58, -0.81, 0) within 4 cm, the hand pointing down, the fingers side by side
  across that direction: that is the direction of closing, and it is horizontal.
- The foremost point of the fingers ends 0.9 to 2.0 cm beyond the origin along it (synthetic: 0.1 to 2.1 cm). The
  drawer was closed at all of these ends, so the face of the closed handle is where the recorded demonstration that went
  least far left the fingers: 0.9 cm beyond the origin. The policy's target, their mean, puts them 1.3 cm beyond: it
  presses the drawer home.
- The fingertips' height stays within 2.7 cm of the origin's during the push, and the hand above them reaches 3.3 cm
  forward: a handle 6.5 cm high at the origin's height, 6 cm before the front, is met by the fingers. (One 3 cm high let
  fingers that came 3 cm higher slip behind it, from starts 0.15 rad off.) The wrist
  leans over the closed drawer, so the cabinet is 9.5 cm higher than the handle, no more.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ._parts import LIGHT_WOOD, METAL, WOOD, add_body, add_box, before_panda, on_panda, pose_or, upright
from ._scene import Left, Plotted, Scene

PUSH = np.array([0.58, -0.81, 0.0]) / np.hypot(0.58, 0.81)
"""Direction of closing, in the object's frame."""
CLOSED_FACE = 0.009  # of the handle beyond the origin along PUSH, m
OPENING = 0.15  # how far the drawer stands open at the start, m
TRAVEL = 0.25  # m
_FRICTION = 3.0  # N, dry, of the slide
_DAMPING = 5.0  # N s/m
DRAWER_POSE = np.array([0.641, -0.436, 0.236])  # where the recorded demonstrations end on average, in the base, m


@dataclass(frozen=True, eq=False)
class Drawer(Scene):
    """The task is done when the drawer is open by at most `closed`, m; starts vary."""

    may_touch: tuple[str, ...] = ("drawer_handle", "drawer_front")
    joint: str = "drawer_slide"
    start: float = OPENING
    plotted: Plotted | None = Plotted("drawer open (mm)", 1000.0, 5.0)
    goal: str = "closed"
    closed: float = 0.005

    def left(self, data: Any) -> Left:
        error = abs(self.joint_position(data))
        return Left(error <= self.closed, f"open by {1000 * error:.1f} mm", error)


def drawer(T_world_object: np.ndarray | None = None) -> Drawer:
    """The Panda before a drawer that stands open; the object is at `T_world_object` [4, 4], default as recorded."""
    T = pose_or(T_world_object, DRAWER_POSE)
    return Drawer("drawer", drawer_spec(T), T_world_object=T, **on_panda())


def drawer_spec(T: np.ndarray) -> Any:
    """The editable model, its camera before an object at `T` [4, 4]."""
    spec, thing = before_panda(T, [0.75, 1.15, 0.75], [-0.25, 0.15, 0.05])
    # The cabinet is fixed in the object's frame, the drawer on its slide: 0 m is closed.
    # x points out of the cabinet, so that opening is positive; the origin is the face of the closed handle.
    cabinet = add_body(thing, "cabinet", CLOSED_FACE * PUSH, upright(-PUSH))
    add_box(cabinet, "cabinet_top", [-0.345, 0.0, 0.085], [0.25, 0.24, 0.01], WOOD)
    add_box(cabinet, "cabinet_bottom", [-0.345, 0.0, -0.185], [0.25, 0.24, 0.01], WOOD)
    add_box(cabinet, "cabinet_left", [-0.345, -0.23, -0.05], [0.25, 0.01, 0.125], WOOD)
    add_box(cabinet, "cabinet_right", [-0.345, 0.23, -0.05], [0.25, 0.01, 0.125], WOOD)
    add_box(cabinet, "cabinet_back", [-0.585, 0.0, -0.05], [0.01, 0.22, 0.125], WOOD, touches=False)
    drawer = add_body(cabinet, "drawer", [0.0, 0.0, 0.0])
    drawer.add_joint(
        name="drawer_slide",
        type=2,  # mjJNT_SLIDE
        axis=[1.0, 0.0, 0.0],
        range=[0.0, TRAVEL],
        limited=True,
        frictionloss=_FRICTION,
        damping=_DAMPING,
        solref_limit=[0.01, 1.0],
    )
    add_box(drawer, "drawer_handle", [-0.01, 0.0, 0.0], [0.01, 0.15, 0.0325], METAL, mass=0.3)
    for side in (-1.0, 1.0):
        name = "drawer_post_left" if side < 0 else "drawer_post_right"
        add_box(drawer, name, [-0.045, 0.12 * side, 0.0], [0.025, 0.008, 0.01], METAL, mass=0.05, touches=False)
    add_box(drawer, "drawer_front", [-0.08, 0.0, -0.05], [0.01, 0.215, 0.12], LIGHT_WOOD, mass=1.2)
    inside = {"rgba": LIGHT_WOOD, "mass": 0.4, "touches": False}
    add_box(drawer, "drawer_bottom", [-0.29, 0.0, -0.16], [0.2, 0.2, 0.006], **inside)
    add_box(drawer, "drawer_left", [-0.29, -0.2, -0.10], [0.2, 0.006, 0.06], **inside)
    add_box(drawer, "drawer_right", [-0.29, 0.2, -0.10], [0.2, 0.006, 0.06], **inside)
    return spec
