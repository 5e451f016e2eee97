"""Obstacles that can be dragged about: balls in the slots of the world, and the capsules that a scene brings.

What is solid is drawn apart from its gizmo and follows it no faster than solid things move: a gizmo is where the mouse
is, which jumps, and is read once a frame, however long that took.
"""

import dataclasses
from typing import Any

import numpy as np

from ..world import Capsules, Spheres, World

BALL_RADIUS = 0.06  # m
SPEED, _READ = 0.5, 1 / 60  # m/s of simulated time, and the most of it, s, that counts from one look to the next
_COLOUR = (204, 77, 51)


class ObstacleGizmos:
    """Balls and capsules with a gizmo each, and the `World` as they stand.

    **Arguments**: `server`; `balls` [N, 3], where they are at first, m; `shown`, how many of them are there at first;
    `world`, whose active capsules become draggable too, sideways.
    """

    def __init__(self, server: Any, balls: np.ndarray, shown: int, world: World):
        scene = server.scene
        self._boxes, self._solids = [], []
        for k, center in enumerate(balls):
            self._boxes.append(server.gui.add_checkbox(f"ball {k + 1}", k < shown))
            gizmo = scene.add_transform_controls(
                f"/ball_{k + 1}", scale=0.18, disable_rotations=True, position=center, visible=k < shown
            )
            drawn = scene.add_icosphere(f"/solid_ball_{k + 1}", radius=BALL_RADIUS, color=_COLOUR, position=center)
            self._solids.append(_Solid(gizmo, drawn, np.array(center, float)))
        capsules = Capsules.of([]) if world.capsules is None else world.capsules
        rows = np.flatnonzero(np.asarray(capsules.active))
        self._capsules = []
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
            drawn = scene.add_cylinder(
                f"/solid_capsule_{k + 1}", radius=radius, height=length, color=_COLOUR, position=middle
            )
            self._solids.append(_Solid(gizmo, drawn, middle))
            self._capsules.append((ends - middle, radius))
        self._last: tuple | None = None
        self._drawn: World | None = None
        self._world = self.read()

    def read(self, seconds: float = np.inf) -> World:
        """The world, everything nearer to where it is on the page by what it can move in so many simulated `seconds`,
        which are infinite where none pass; the same object until something moves."""
        shown = tuple(bool(box.value) for box in self._boxes)
        count = len(shown)
        for solid, visible in zip(self._solids, (*shown, *[True] * len(self._capsules)), strict=True):
            most = SPEED * min(seconds, _READ) if visible and np.isfinite(seconds) else np.inf
            solid.follow(most)
        state = (shown, *(tuple(solid.at) for solid in self._solids))
        if state == self._last:
            return self._world
        for solid, visible in zip(self._solids, shown, strict=False):
            solid.gizmo.visible = solid.drawn.visible = visible
        at = [solid.at for solid in self._solids]
        balls = Spheres(np.reshape(at[:count], (-1, 3)), np.full(count, BALL_RADIUS), np.array(shown, bool))
        capsules = Capsules.of(
            [(*(middle + ends), radius) for middle, (ends, radius) in zip(at[count:], self._capsules, strict=True)]
        )
        self._world = World(spheres=balls, capsules=capsules)
        self._last = state
        return self._world

    def draw(self, world: World) -> None:
        """Put what is solid where the `world` of a frame has it."""
        if world is self._drawn:
            return
        self._drawn, at = world, [np.zeros((0, 3))]
        if world.spheres is not None:
            at.append(np.asarray(world.spheres.center))
        if world.capsules is not None:
            at.append((np.asarray(world.capsules.start) + np.asarray(world.capsules.end)) / 2)
        for solid, position in zip(self._solids, np.concatenate(at), strict=True):
            if np.isfinite(position).all():
                solid.drawn.position = position


@dataclasses.dataclass
class _Solid:
    """What is `drawn`, and goes to where its `gizmo` is; it is `at` [3]."""

    gizmo: Any
    drawn: Any
    at: np.ndarray

    def follow(self, most: float) -> None:
        """Go there, by `most` m. What is nowhere, a position that is not finite, is there at once."""
        goal = np.array(self.gizmo.position, float)
        away = float(np.linalg.norm(goal - self.at))
        self.at = self.at + most / away * (goal - self.at) if away > most else goal
