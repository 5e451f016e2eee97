"""One obstacle that can be dragged, turned, and made a ball, a box, a bar, or nothing."""

from typing import Any

import numpy as np

from .._rotations import pose, rotation_of_quaternion
from ._poses import place

OFF, SPHERE, BOX, CAPSULE = "off", "sphere", "box", "capsule"
RADIUS, LENGTH = 0.06, 0.15  # m, at first
_COLOUR = (204, 77, 51)


class Solid:
    """What goes to where its gizmo is no faster than solid things move.

    `at` [3], m; `wxyz` [4], how it is turned; `size` [2], radius or half a side, and half the length, m.
    """

    def __init__(self, at: Any, size: Any, wxyz: Any = (1.0, 0.0, 0.0, 0.0)):
        self.at, self.size, self.wxyz = (np.array(x, float) for x in (at, size, wxyz))

    @property
    def state(self) -> tuple[float, ...]:
        """All its numbers."""
        return (*self.at.tolist(), *self.wxyz.tolist(), *self.size.tolist())

    @property
    def T(self) -> np.ndarray:
        """Its pose [4, 4]."""
        return pose(self.at, rotation_of_quaternion(self.wxyz))

    def follow(self, at: Any, wxyz: Any, size: Any, most: float) -> None:
        """Go there, turn and grow, so that no point of it moves by more than about `most` m in each of these. What is
        nowhere, a position that is not finite, is there at once; what shrinks, too."""
        at, wxyz, size = (np.array(x, float) for x in (at, wxyz, size))
        away = float(np.linalg.norm(at - self.at))
        self.at = self.at + most / away * (at - self.at) if away > most else at
        wxyz = wxyz if self.wxyz @ wxyz >= 0 else -wxyz
        turn = 2 * float(np.arccos(min(self.wxyz @ wxyz, 1.0))) * float(self.size.max())
        part = self.wxyz + (most / turn if turn > most else 1.0) * (wxyz - self.wxyz)
        self.wxyz = part / np.linalg.norm(part)
        self.size = np.minimum(size, self.size + most)


class Slot:
    """A place for an obstacle: its gizmo, its controls, and how it is drawn.

    **Arguments**: `server`; `number`, counted from 1; `at` [3], where it is at first, m; `shown`, whether it is there.
    """

    def __init__(self, server: Any, number: int, at: Any, shown: bool):
        gui, self._scene, self._name = server.gui, server.scene, f"/solid_{number}"
        self.kind = gui.add_dropdown(
            f"obstacle {number}", (OFF, SPHERE, BOX, CAPSULE), initial_value=SPHERE if shown else OFF
        )
        self.radius = gui.add_slider("radius or half side (m)", 0.01, 0.2, step=0.005, initial_value=RADIUS)
        self.length = gui.add_slider("half length (m)", 0.02, 0.6, step=0.01, initial_value=LENGTH)
        self.gizmo = self._scene.add_transform_controls(f"/obstacle_{number}", scale=0.18, position=at)
        self._node = self._scene.add_frame(self._name, show_axes=False, position=at)
        self.solid = Solid(at, (RADIUS, LENGTH))
        self._drawn: tuple | None = None
        self._shape: Any = None
        self._arranged = ""

    def follow(self, most: float) -> str:
        """Take in what the page says, moving by `most` m; the kind that it is now."""
        kind = str(self.kind.value)
        size = float(self.radius.value), float(self.length.value)
        self.solid.follow(self.gizmo.position, self.gizmo.wxyz, size, np.inf if kind == OFF else most)
        if kind != self._arranged:
            self._arranged, there = kind, kind != OFF
            self.gizmo.visible, self.gizmo.disable_rotations = there, kind == SPHERE
            self.radius.visible, self.length.visible = there, kind in (BOX, CAPSULE)
        return kind

    def draw(self, kind: str, T: np.ndarray, radius: float, length: float) -> None:
        """Put it on the page as the policy has it: `T` [4, 4], and its sizes, m."""
        if np.isfinite(T).all():
            place(self._node, T)
        wanted = (kind, round(radius, 4), round(length, 4))
        if wanted == self._drawn:
            return
        self._drawn = wanted
        if self._shape is not None:
            self._shape.remove()
            self._shape = None
        name, look = f"{self._name}/{kind}", {"color": _COLOUR, "cast_shadow": False}
        if kind == SPHERE:
            self._shape = self._scene.add_icosphere(name, radius=radius, **look)
        elif kind == BOX:
            self._shape = self._scene.add_box(name, dimensions=(2 * radius, 2 * radius, 2 * length), **look)
        elif kind == CAPSULE:
            from trimesh import creation

            solid = creation.capsule(radius=radius, height=2 * length, count=(12, 12))
            solid.vertices[:, 2] -= solid.bounds[:, 2].mean()
            vertices, faces = np.asarray(solid.vertices), np.asarray(solid.faces)
            self._shape = self._scene.add_mesh_simple(name, vertices, faces, **look)
