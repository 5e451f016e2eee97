"""What a sequence is: states, each a policy, when it is over, and what comes then."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import numpy as np

from .._errors import ConfigurationError, ShapeError, UnknownNameError
from .._pytree import pytree, static
from .._task_map import check_rigid
from ..scenes._gripper import Width, check_width

END = "end"
"""Where a state leads to that is the last one."""
RELATIVE_TO = ("object", "world")


class Arrived(NamedTuple):
    """A state is over once its aim is there: a point within `position`, m, turned within `angle`, rad, and slower than
    `speed`, m/s, for `hold` seconds.

    That may take `timeout`, s, after which the sequence goes on at the state `otherwise`, or fails if that is None.
    """

    position: float = 0.01
    angle: float = float(np.radians(10.0))
    speed: float = 0.02
    hold: float = 0.2
    timeout: float = 20.0
    otherwise: str | None = None


class After(NamedTuple):
    """A state is over after `seconds`."""

    seconds: float


class GripperMove(NamedTuple):
    """What the fingers do once a state is over, while its policy still holds the arm: `width`, "open", "close" or m
    between them, within `seconds`."""

    width: Width
    seconds: float = 1.0


@pytree
class Aim:
    """What arrives where: `point` [3], m, in `frame` of the robot, at the place of `T_target_aim` [4, 4] in the frame
    of the state's target, turned like it if `turned`."""

    point: jax.Array
    T_target_aim: jax.Array
    frame: str = static()
    turned: bool = static(default=True)


@dataclass(frozen=True, eq=False)
class State:
    """A policy, and until when it acts.

    `name`; `policy`, a pytree with a method `tree(T_world_target, world)`, as `policies.ArmPolicy`; `guard`, when it is
    over: `Arrived` or `After`; `aim`, what is to arrive, None where nothing is; `gripper`, what the fingers do then;
    `then`, the state after it, None for the next in order, `END` for none. Its target is at `T_target` [4, 4] in the
    frame of what it is `relative_to`: the "object" of the scene, wherever that is, or the "world".

    **Raises** `ConfigurationError` for numbers that make no sense, or an arrival without an aim;
    `UnknownNameError` for another `relative_to`; `RigidTransformError`, `ShapeError` for what is no pose.
    """

    name: str
    policy: Any
    guard: Arrived | After
    aim: Aim | None = None
    gripper: GripperMove | None = None
    then: str | None = None
    relative_to: str = "object"
    T_target: np.ndarray = field(default_factory=lambda: np.eye(4))

    def __post_init__(self):
        UnknownNameError.check(f"relative_to of state {self.name!r}", self.relative_to, RELATIVE_TO)
        if check_rigid(self.T_target, f"T_target of state {self.name!r}").shape != (4, 4):
            raise ShapeError(
                f"T_target of state {self.name!r} has shape {np.shape(self.T_target)}, expected (4, 4): one target."
            )
        numbers = {key: value for key, value in self.guard._asdict().items() if key != "otherwise"}
        if self.gripper is not None:
            check_width(self.gripper.width)
            numbers["gripper.seconds"] = self.gripper.seconds
        for key, value in numbers.items():
            if not value >= 0 or (value == 0 and key != "hold"):
                raise ConfigurationError(f"state {self.name!r}: {key} is {value!r}, expected a positive number.")
        if isinstance(self.guard, Arrived) and self.aim is None:
            raise ConfigurationError(f"state {self.name!r} waits for an arrival and has no aim: what is to arrive?")

    def target(self, T_world_object: np.ndarray) -> np.ndarray:
        """`T_world_target` [4, 4] with the object at `T_world_object` [4, 4]."""
        return self.T_target if self.relative_to == "world" else T_world_object @ self.T_target


@dataclass(frozen=True, eq=False)
class Sequence:
    """`states`, the first of which begins; `limit`, s, for all of them together.

    **Raises** `ConfigurationError` for no states, or a name that is there twice; `UnknownNameError` for a state that a
    `then` or an `otherwise` names and that is not there.
    """

    states: tuple[State, ...]
    limit: float = 120.0

    def __post_init__(self):
        names = [state.name for state in self.states]
        if not names or END in names or len(set(names)) < len(names):
            raise ConfigurationError(f"the states are {names}: expected at least one, each named once, none {END!r}.")
        if not 0 < self.limit < np.inf:
            raise ConfigurationError(f"limit is {self.limit!r}, expected a positive number of seconds.")
        for state in self.states:
            for key, name in (("then", state.then), ("otherwise", getattr(state.guard, "otherwise", None))):
                if name is not None:
                    UnknownNameError.check(f"state, {key} of state {state.name!r},", name, [*names, END])

    def after(self, index: int) -> str:
        """The name of the state that follows the one of number `index`, or `END`."""
        state, ahead = self.states[index], self.states[index + 1 : index + 2]
        return state.then or (ahead[0].name if ahead else END)

    def index(self, name: str) -> int:
        """The number of the state called `name`."""
        return [state.name for state in self.states].index(name)
