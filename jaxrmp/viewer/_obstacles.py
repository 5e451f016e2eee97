"""Obstacles that can be dragged about: balls in the slots of the world, and the capsules that a scene brings."""

from typing import Any

import numpy as np

from ..world import Capsules, Spheres, World

BALL_RADIUS = 0.06  # m
_COLOUR = (204, 77, 51)


class ObstacleGizmos:
    """Balls and capsules with a gizmo each, and the `World` as they stand.

    **Arguments**: `server`; `balls` [N, 3], where they are at first, m; `shown`, how many of them are there at first;
    `world`, whose active capsules become draggable too, sideways.
    """

    def __init__(self, server: Any, balls: np.ndarray, shown: int, world: World):
        scene = server.scene
        self._boxes, self._balls, self._capsules = [], [], []
        for k, center in enumerate(balls):
            self._boxes.append(server.gui.add_checkbox(f"ball {k + 1}", k < shown))
            gizmo = scene.add_transform_controls(
                f"/ball_{k + 1}", scale=0.18, disable_rotations=True, position=center, visible=k < shown
            )
            scene.add_icosphere(f"/ball_{k + 1}/ball", radius=BALL_RADIUS, color=_COLOUR)
            self._balls.append(gizmo)
        capsules = Capsules.of([]) if world.capsules is None else world.capsules
        rows = np.flatnonzero(np.asarray(capsules.active))
        for k, row in enumerate(rows):
            ends = np.stack([np.asarray(capsules.start)[row], np.asarray(capsules.end)[row]])
            middle, radius = ends.mean(0), float(np.asarray(capsules.radius)[row])
            gizmo = scene.add_transform_controls(
                f"/capsule_{k + 1}",
                scale=0.25,
                disable_rotations=True,
                active_axes=(True, True, False),
                position=middle,
            )
            length = float(np.linalg.norm(ends[1] - ends[0])) + 2 * radius
            scene.add_cylinder(f"/capsule_{k + 1}/cylinder", radius=radius, height=length, color=_COLOUR)
            self._capsules.append((gizmo, ends - middle, radius))
        self._last: tuple | None = None
        self._world = self.read()

    def read(self) -> World:
        """The world with everything where it is on the page; the same object until something moves."""
        shown = tuple(bool(box.value) for box in self._boxes)
        positions = [np.array(gizmo.position, float) for gizmo in self._balls]
        middles = [np.array(gizmo.position, float) for gizmo, *_ in self._capsules]
        state = (shown, *(tuple(p) for p in (*positions, *middles)))
        if state == self._last:
            return self._world
        for gizmo, visible in zip(self._balls, shown, strict=True):
            gizmo.visible = visible
        balls = Spheres(np.reshape(positions, (-1, 3)), np.full(len(positions), BALL_RADIUS), np.array(shown, bool))
        ends = [middle + offset for middle, (_, offset, _) in zip(middles, self._capsules, strict=True)]
        capsules = Capsules.of([(*pair, radius) for pair, (*_, radius) in zip(ends, self._capsules, strict=True)])
        self._world = World(spheres=balls, capsules=capsules)
        self._last = state
        return self._world
