"""A robot as a value: a tree of bodies and joints (structure) and the limits of its coordinates (parameters)."""

import dataclasses
import functools
import hashlib
from typing import Literal, NamedTuple

import jax
import numpy as np

from .._errors import RobotError, ShapeError, UnknownNameError
from .._pytree import as_floats, pytree, set_field, static

Vector = tuple[float, float, float]
Rotation = tuple[float, float, float, float, float, float, float, float, float]


class Body(NamedTuple):
    """A rigid body: where it sits in its parent body while its joints are at their reference positions."""

    name: str
    parent: int  # index of the parent body; -1 for the world
    position: Vector  # origin in the parent, m
    rotation: Rotation  # rows of R_parent_body


class Joint(NamedTuple):
    """A revolute or prismatic joint that moves `body`; a body's joints act in their order in the model.

    Its position is `multiplier * q[coordinate] + offset`. A joint of its own has multiplier 1 and offset 0; a mimic
    joint shares its leader's coordinate; a locked joint has coordinate -1 and sits at `offset`.
    """

    name: str
    body: int
    kind: Literal["revolute", "prismatic"]
    axis: Vector  # unit vector in the body
    anchor: Vector  # a point of the axis in the body, m
    reference: float  # joint position in which the body has its fixed pose, rad or m
    coordinate: int
    multiplier: float
    offset: float


class Frame(NamedTuple):
    """A named pose fixed to a body: the body's own frame, or a site on it."""

    name: str
    body: int
    position: Vector
    rotation: Rotation


@dataclasses.dataclass(frozen=True, repr=False)
class KinematicModel:
    """The structure of a robot, as hashable Python numbers: JAX compiles it into the program.

    `bodies` are ordered so that a parent comes before its children; body 0 is the world.
    """

    name: str
    joint_names: tuple[str, ...]  # the independent joints, in the order of their coordinates
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    frames: tuple[Frame, ...]
    # The file it was read from, where its geometry is; no part of what makes models equal.
    source: str | None = dataclasses.field(default=None, compare=False)
    # Folders of the ROS packages that it names, as far as they were given; as above.
    packages: tuple[tuple[str, str], ...] = dataclasses.field(default=(), compare=False)
    # Pairs of its frames that may touch; how far spheres that cover it may stick out, m, 0 where not said; as above.
    ignore: tuple[tuple[str, str], ...] = dataclasses.field(default=(), compare=False)
    cover_error: float = dataclasses.field(default=0.0, compare=False)
    # The TOML file that named all this, if one did; as above.
    robot_file: str | None = dataclasses.field(default=None, compare=False)

    @functools.cached_property
    def fingerprint(self) -> str:
        """Sixteen hexadecimal digits that identify the kinematic content: everything but the model's own name.

        Numbers enter rounded to 1e-9, so that the same description gives the same fingerprint on every machine.
        """
        parts = (self.bodies, self.joints, self.frames)
        lines = [_stable(self.joint_names), *(_stable(tuple(entry)) for part in parts for entry in part)]
        return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]

    @functools.cached_property
    def frame_of_name(self) -> dict[str, int]:
        """Index of each frame by its name."""
        return {frame.name: i for i, frame in enumerate(self.frames)}

    @functools.cached_property
    def joints_of_body(self) -> tuple[tuple[int, ...], ...]:
        """Indices of each body's joints, in the order in which they act."""
        return tuple(tuple(i for i, j in enumerate(self.joints) if j.body == b) for b in range(len(self.bodies)))

    def path(self, body: int) -> tuple[int, ...]:
        """Bodies from below the world down to `body`."""
        chain = []
        while body > 0:
            chain.append(body)
            body = self.bodies[body].parent
        return tuple(reversed(chain))

    def joints_above(self, body: int, locked: bool = False) -> list[int]:
        """Indices of the joints that move `body`, with those that are `locked` or without."""
        joints = [i for b in self.path(body) for i in self.joints_of_body[b]]
        return [i for i in joints if locked or self.joints[i].coordinate >= 0]

    def rigid_root(self, body: int) -> int:
        """The body that a joint moves, locked ones aside, and that `body` is rigidly joined to; or the world."""
        while body > 0 and not any(self.joints[i].coordinate >= 0 for i in self.joints_of_body[body]):
            body = self.bodies[body].parent
        return body

    @functools.cached_property
    def _hash(self) -> int:
        return int(self.fingerprint, 16)

    def __hash__(self) -> int:
        return self._hash

    def __repr__(self) -> str:
        return f"KinematicModel({self.name!r}, {len(self.bodies)} bodies, {len(self.joints)} joints)"


def _stable(value) -> str:
    if isinstance(value, float):
        return f"{round(value, 9) + 0.0:.9f}"  # adding 0.0 turns -0.0 into 0.0
    if isinstance(value, tuple):
        return "(" + " ".join(map(_stable, value)) + ")"
    return str(value)


@pytree
class Robot:
    """A robot of n independent joints.

    `lower`, `upper` [n]: joint limits, rad or m, infinite where there is none; `velocity_limit` [n], rad/s or m/s.
    These are parameters. `model`, the kinematic tree, is structure: robots that share it share compiled programs.

    **Raises** `ShapeError` when a limit does not have n entries.
    """

    lower: jax.Array | np.ndarray
    upper: jax.Array | np.ndarray
    velocity_limit: jax.Array | np.ndarray
    model: KinematicModel = static()

    def __post_init__(self):
        for name in ("lower", "upper", "velocity_limit"):
            value = as_floats(getattr(self, name))
            set_field(self, name, value)
            if value.shape != (self.num_joints,):
                raise ShapeError(f"{name} has shape {value.shape}, expected ({self.num_joints},): one per joint.")

    @property
    def name(self) -> str:
        """The robot's name."""
        return self.model.name

    @property
    def source(self) -> str | None:
        """The MJCF or URDF file that the robot was read from, None if it was read from text."""
        return self.model.source

    @property
    def num_joints(self) -> int:
        """Number n of independent joints."""
        return len(self.model.joint_names)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the independent joints, in the order of `q`."""
        return self.model.joint_names

    @property
    def limited(self) -> tuple[int, ...]:
        """Coordinates of the joints that have limits on both sides. The limits must be numbers, not traced by JAX."""
        return tuple(np.flatnonzero(np.isfinite(self.lower) & np.isfinite(self.upper)).tolist())

    @property
    def middle(self) -> np.ndarray:
        """The middle of every joint's range [n], zero where there is none. The limits must be numbers, as above."""
        rows, q = list(self.limited), np.zeros(self.num_joints)
        q[rows] = (np.asarray(self.lower)[rows] + np.asarray(self.upper)[rows]) / 2
        return q

    def check_ranges(self, lower=None, upper=None) -> None:
        """**Raises** `RobotError`, by name, if a joint's range from `lower` to `upper` [n], the limits, is empty."""
        low, high = (np.asarray(b if a is None else a) for a, b in ((lower, self.lower), (upper, self.upper)))
        empty = [f"{name} from {a:g} to {b:g}" for name, a, b in zip(self.joint_names, low, high, strict=True)
                 if not a < b]  # fmt: skip
        if empty:
            raise RobotError(f"robot {self.name!r}: the limits of these joints leave no range: {', '.join(empty)}.")

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Names of all frames: bodies first, then sites."""
        return tuple(frame.name for frame in self.model.frames)

    @property
    def fingerprint(self) -> str:
        """Identifies the kinematic content (not the limits), the same on every machine."""
        return self.model.fingerprint

    def frame_index(self, name: str) -> int:
        """Index of the frame called `name`. **Raises** `UnknownNameError`."""
        UnknownNameError.check("frame", name, self.model.frame_of_name)
        return self.model.frame_of_name[name]

    def joint_index(self, name: str) -> int:
        """Coordinate of the independent joint called `name`. **Raises** `UnknownNameError`."""
        dependent = any(j.name == name for j in self.model.joints)
        hint = "This joint is locked or follows another one, so it has no coordinate." if dependent else ""
        UnknownNameError.check("joint", name, self.joint_names, hint)
        return self.joint_names.index(name)

    def __repr__(self) -> str:
        return f"Robot({self.name!r}, joints={list(self.joint_names)})"
