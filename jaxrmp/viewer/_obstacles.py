"""Obstacles that can be dragged about, added, changed and taken away, and the capsules that a scene brings.

What is solid is drawn apart from its gizmo and follows it no faster than solid things move: a gizmo is where the mouse
is, which jumps, and is read once a frame, however long that took.
"""

import dataclasses
from typing import Any

import numpy as np

from ..world import Boxes, Capsules, Spheres, World
from ._slot import BOX, CAPSULE, LENGTH, OFF, RADIUS, SPHERE, Slot, Solid

SLOTS = 3
"""How many obstacles there can be at once. Their number is part of the compiled program: no more can be added."""
SPEED, _READ = 0.5, 1 / 60  # m/s of simulated time, and the most of it, s, that counts from one look to the next
_COLOUR = (204, 77, 51)


def world_of(solids: list[Solid], kinds: list[str], capsules: Capsules | None, still: World) -> World:
    """The world with N `solids`, each of its kind, then the `capsules`, then what stands `still`.

    Every solid has a row of each kind, of which one at most counts: so it can change its kind, and nothing is
    compiled again.
    """
    T = np.reshape([solid.T for solid in solids], (-1, 4, 4))
    radius, half = np.reshape([solid.size for solid in solids], (-1, 2)).T
    along = half[:, None] * T[:, :3, 2]
    at, of = T[:, :3, 3], np.array(kinds, object)
    return World(
        _joined(Spheres(at, radius, of == SPHERE), still.spheres),
        _joined(Capsules(at - along, at + along, radius, of == CAPSULE), capsules),
        _joined(Boxes(T, np.stack([radius, radius, half], axis=1), of == BOX), still.boxes),
        still.cylinders,
        still.half_spaces,
        still.grids,
    )


def slots_of(world: World, count: int) -> list[tuple[str, np.ndarray, float, float]]:
    """What the first `count` rows of a `world_of` are: kind, pose [4, 4], radius and half length, m."""
    if not count:
        return []
    assert world.spheres is not None and world.capsules is not None and world.boxes is not None
    kinds = {SPHERE: world.spheres.active, BOX: world.boxes.active, CAPSULE: world.capsules.active}
    active = {kind: np.asarray(rows)[:count] for kind, rows in kinds.items()}
    T, half = np.asarray(world.boxes.T_world_box, float)[:count], np.asarray(world.boxes.half_extents, float)[:count]
    named = [next((kind for kind, rows in active.items() if rows[k]), OFF) for k in range(count)]
    return [(named[k], T[k], float(half[k, 0]), float(half[k, 2])) for k in range(count)]


def at_first(places: np.ndarray, world: World) -> World:
    """A world of the size that `ObstacleGizmos` will have it."""
    solids = [Solid(at, (RADIUS, LENGTH)) for at in places]
    return world_of(solids, [OFF] * len(solids), world.capsules, world)


class ObstacleGizmos:
    """Slots for obstacles and a scene's capsules, each with a gizmo, and the `World` as they stand.

    **Arguments**: `server`; `places` [N, 3], where the slots' obstacles are at first, m; `shown`, how many of them are
    there at first; `world`, whose active capsules become draggable too, sideways, and the rest of which stands still.
    """

    def __init__(self, server: Any, places: np.ndarray, shown: int, world: World):
        self._still = world
        self.slots = [Slot(server, k + 1, at, k < shown) for k, at in enumerate(places)]
        if len(places):
            server.gui.add_markdown(f"{len(places)} at most: the policy was compiled for so many.")
            server.gui.add_button("Add an obstacle", icon="plus").on_click(lambda _: self.add())
        self._capsules = _capsule_gizmos(server, world.capsules)
        self._last: tuple | None = None
        self._drawn: World | None = None
        self._world = self.read()

    @property
    def present(self) -> int:
        """How many obstacles there are now."""
        return sum(slot.kind.value != OFF for slot in self.slots) + len(self._capsules) + self._standing

    @property
    def _standing(self) -> int:
        kinds = (self._still.spheres, self._still.boxes, self._still.cylinders, self._still.half_spaces)
        return sum(int(np.asarray(kind.active).sum()) for kind in kinds if kind is not None) + len(self._still.grids)

    def add(self) -> None:
        """Make the first slot that is off a sphere."""
        for slot in self.slots:
            if slot.kind.value == OFF:
                slot.kind.value = SPHERE
                return

    def read(self, seconds: float = np.inf) -> World:
        """The world, everything nearer to where it is on the page by what it can move in so many simulated `seconds`,
        which are infinite where none pass; the same object until something moves."""
        most = SPEED * min(seconds, _READ) if np.isfinite(seconds) else np.inf
        kinds = [slot.follow(most) for slot in self.slots]
        for solid, gizmo, _, _ in self._capsules:
            solid.follow(gizmo.position, solid.wxyz, solid.size, most)
        solids = [*(slot.solid for slot in self.slots), *(solid for solid, *_ in self._capsules)]
        state = (*kinds, *(solid.state for solid in solids))
        if state == self._last:
            return self._world
        rows = [(*(solid.at + ends), float(solid.size[0])) for solid, _, _, ends in self._capsules]
        self._world = world_of(solids[: len(kinds)], kinds, Capsules.of(rows), self._still)
        self._last = state
        return self._world

    def draw(self, world: World) -> None:
        """Put what is solid where the `world` of a frame has it."""
        if world is self._drawn:
            return
        self._drawn, count = world, len(self.slots)
        for slot, row in zip(self.slots, slots_of(world, count), strict=True):
            slot.draw(*row)
        if self._capsules and world.capsules is not None:
            at = (np.asarray(world.capsules.start) + np.asarray(world.capsules.end))[count:] / 2
            for (_, _, drawn, _), position in zip(self._capsules, at, strict=True):
                if np.isfinite(position).all():
                    drawn.position = position


def _capsule_gizmos(server: Any, capsules: Capsules | None) -> list[tuple[Solid, Any, Any, np.ndarray]]:
    """A scene's active capsules: each as a solid, its gizmo, what is drawn, and its ends [2, 3] about its middle."""
    if capsules is None:
        return []
    found, scene = [], server.scene
    for k, row in enumerate(np.flatnonzero(np.asarray(capsules.active)), 1):
        ends = np.stack([np.asarray(capsules.start)[row], np.asarray(capsules.end)[row]]).astype(float)
        middle, radius = ends.mean(0), float(np.asarray(capsules.radius)[row])
        way = {"disable_rotations": True, "active_axes": (True, True, False)}
        gizmo = scene.add_transform_controls(f"/capsule_{k}", scale=0.25, position=middle, **way)
        height = float(np.linalg.norm(ends[1] - ends[0])) + 2 * radius
        look = {"radius": radius, "height": height, "color": _COLOUR, "position": middle}
        drawn = scene.add_cylinder(f"/solid_capsule_{k}", **look)
        found.append((Solid(middle, (radius, height / 2)), gizmo, drawn, ends - middle))
    return found


def _joined(own: Any, more: Any) -> Any:
    """The rows of two sets of obstacles of one kind, one after the other."""
    if more is None:
        return own
    fields = [field.name for field in dataclasses.fields(own)]
    return type(own)(*(np.concatenate([np.asarray(getattr(x, name)) for x in (own, more)]) for name in fields))
