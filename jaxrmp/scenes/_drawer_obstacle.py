"""The drawer with a cylinder standing in the way of the demonstrations."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .._errors import ConfigurationError
from ..world import Capsules, World
from ._drawer import DRAWER_POSE, Drawer, drawer_spec
from ._parts import add_bar, add_geom, on_panda, pose_or
from ._scene import Scene

CYLINDER_SPREAD = 0.03
"""Of the cylinder's place, m, in each horizontal direction."""
LEAST_CROSSED = 4
"""A seeded cylinder stands in the way of at least this many demonstrations (or all, if fewer)."""


class Cylinder(NamedTuple):
    """A standing cylinder: `center` of its foot in the object's frame, `radius` and `height`, all in m.

    Its foot is on the floor whatever the height of the object. What the arm touches is a capsule of the same radius
    and height, since MJX has no contact between boxes and cylinders.
    """

    center: tuple[float, float] = (-0.18, 0.215)
    radius: float = 0.025
    height: float = 0.30


@dataclass(frozen=True, eq=False)
class DrawerBehindCylinder(Drawer):
    """The drawer's task, with `cylinder` in the way, whose place varies: a new one for every round of starts."""

    cylinder: Cylinder = Cylinder()
    per_round: bool = True

    def place(self, data: Any, T_world_object: np.ndarray) -> None:
        super().place(data, T_world_object)
        data.mocap_pos[1], data.mocap_quat[1] = self._foot(np.asarray(T_world_object)), [1.0, 0.0, 0.0, 0.0]

    def obstacles(self, T_world_object: np.ndarray | None = None) -> World:
        """The cylinder as the capsule that it is."""
        foot = self._foot(self.T_world_object if T_world_object is None else np.asarray(T_world_object))
        r, up = self.cylinder.radius, np.array([0.0, 0.0, 1.0])
        return World(capsules=Capsules.of([(foot + r * up, foot + (self.cylinder.height - r) * up, r)]))

    def vary(self, trial: Any, rng: np.random.Generator, shown: Sequence[tuple[np.ndarray, np.ndarray]]) -> Any:
        x, y = np.array(self.cylinder.center) + rng.uniform(-CYLINDER_SPREAD, CYLINDER_SPREAD, 2)
        found = trial._replace(changes={"cylinder": self.cylinder._replace(center=(float(x), float(y)))})
        there = [self.at(found).with_object(T) for _, T in shown]
        if any(scene.touches(q[:1]) for scene, (q, _) in zip(there, shown, strict=True)):
            return None
        crossed = sum(scene.touches(np.asarray(q)[::4]) for scene, (q, _) in zip(there, shown, strict=True))
        return found if crossed >= min(LEAST_CROSSED, len(shown)) else None

    def _foot(self, T: np.ndarray) -> np.ndarray:
        foot = T[:3, :3] @ [*self.cylinder.center, 0.0] + T[:3, 3]
        return np.array([foot[0], foot[1], 0.0])


def drawer_obstacle(T_world_object: np.ndarray | None = None, cylinder: Cylinder = Cylinder()) -> Scene:  # noqa: B008
    """The Panda before the drawer, a `cylinder` between them; the rest as `drawer`.

    **Raises** `ConfigurationError` for a cylinder that is none.
    """
    if not (cylinder.radius > 0 and cylinder.height > 2 * cylinder.radius):
        raise ConfigurationError(f"{cylinder}: expected a positive radius and a height of more than twice that.")
    T = pose_or(T_world_object, DRAWER_POSE)
    spec = drawer_spec(T)
    body = spec.worldbody.add_body(name="cylinder", mocap=True)
    r, h = cylinder.radius, cylinder.height
    add_geom(body, "CYLINDER", "", [0.8, 0.3, 0.2, 1.0], False, pos=[0, 0, h / 2], size=[r, h / 2, 0])
    add_bar(body, "obstacle", [[0, 0, r], [0, 0, h - r]], r, [0.8, 0.3, 0.2, 0.0])
    return DrawerBehindCylinder("drawer_obstacle", spec, T_world_object=T, cylinder=cylinder, **on_panda())
