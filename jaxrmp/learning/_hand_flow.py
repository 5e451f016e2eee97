"""What a flow makes of a skill: one policy for the whole hand, and what leads joints back to where it was learned."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from .._linalg import einsum, length, matmul
from .._pytree import pytree, single, static
from .._rotations import nearest_rotation
from .._task_map import RigidTransform, TaskMap, Translation, compose, stack
from .._tree import Node, Sum, on_coordinates, pullback
from ..kinematics import ControlPoints, Robot
from ..leaves import CruisingAttractor, Funnel
from ..leaves._smooth_ratios import log_cosh
from ..xla import quickly
from ._by_parts import by_parts
from ._configuration import FlowSettings, PolicySettings
from ._flow import Flow
from ._hand_maps import BeyondTurn, HandPose, HandTurn, Stacked, axes_of, turn_lengths
from ._turn_attractor import TurnAttractor

_DAMPING = 0.02  # of inverse kinematics, m (and rad), so that near a singularity joints stay where they are
_PACE = 5.0  # rad/m: how fast the funnel moves joints, by the hand's speed
_AT_ONCE = 32  # postures in a call of what is compiled
_FARTHEST = 0.5  # rad or m, that a posture of the funnel follows an object
_MARGIN = 0.05  # rad or m that moved postures keep from limits
_AXES = 500  # of turns along which a flow is looked at where its coordinates fade
_FADING = 130.0, 165.0  # degrees, where that is


@pytree
class HandFlow:
    """A `flow` of the whole hand with its `attractor` behind it; `funnel` and `posture`, leaves on the joints, or None.

    `offsets` [P, 3], m, points in the first of the skill's frames that stand for the hand, and `targets` [P, 3] where
    they go, in the object's frame, m; if `turned`, a triangle, which says how the hand is turned, else the skill's
    control points. A flow `of_turn` knows of the triangle's turn alone, and has an attractor that fades where
    coordinates of turns do. `hands` [S + 1, P, 3], m, where these points are in the world, in the postures of the
    funnel and last at the joints' end; `moves` [S + 1, n, 3 P], how joints follow a small motion of them: both for an
    object at the skill's `T_world_object`.
    """

    flow: Flow
    attractor: CruisingAttractor | TurnAttractor
    funnel: Funnel | None
    posture: Funnel | None
    offsets: jax.Array
    targets: jax.Array
    hands: jax.Array
    moves: jax.Array
    turned: bool = static()

    @property
    def of_turn(self) -> bool:
        """Whether it moves how the hand is turned alone, and not where it is."""
        return isinstance(self.attractor, TurnAttractor)

    def task_map(self, robot: Robot, frames: tuple[str, ...], T: jax.Array, targets: jax.Array | None) -> TaskMap:
        """From joint positions [n] of `robot` to the space of the flow, the target at zero.

        **Arguments**: `frames`, the skill's; `T` [4, 4], where the object is; `targets` [P, 3] instead of its own.
        """
        targets = self.targets if targets is None else targets
        points = self._points(robot, frames, T, targets)
        if self.flow.back.shape[-1] == self.offsets.size:  # skills of version 5 have triangles stacked as well
            return points
        return compose(points, HandTurn(targets) if self.of_turn else HandPose(targets))

    def leaf(self, robot: Robot, frames: tuple[str, ...], T: jax.Array, targets: jax.Array | None = None) -> Node:
        """The learned policy as a node on the joint space of `robot`, the object at `T` [4, 4]; the rest, `frames` and
        `targets`, as in `task_map`."""
        if not self.of_turn:
            return pullback(compose(self.task_map(robot, frames, T, targets), self.flow), self.attractor)
        targets = self.targets if targets is None else targets
        turn = stack(compose(HandTurn(targets), self.flow), BeyondTurn(targets))
        return pullback(compose(self._points(robot, frames, T, targets), turn), self.attractor)

    def beyond(self, robot: Robot, frames: tuple[str, ...], T: jax.Array) -> TaskMap:
        """From joint positions [n] to how far a turn is beyond what the flow knows in full [1]: 0 up to 130 degrees;
        `robot`, `frames` and `T` as in `task_map`."""
        return compose(self._points(robot, frames, T, self.targets), BeyondTurn(self.targets))

    def _points(self, robot: Robot, frames: tuple[str, ...], T: jax.Array, targets: jax.Array) -> TaskMap:
        """From joint positions to its points, stacked, the `targets` at zero."""
        frames = frames[:1] * len(self.offsets) if self.turned else frames
        return Stacked(compose(ControlPoints(robot, frames, self.offsets), RigidTransform(T), Translation(targets)))

    def on_joints(
        self,
        robot: Robot,
        joints: tuple[int, ...],
        T_before: jax.Array,
        T: jax.Array,
        targets: jax.Array | None = None,
    ) -> Node:
        """Funnel and posture of the arm, the coordinates `joints` of `robot`, for an object that moved from `T_before`
        to `T` [4, 4], and `targets` [P, 3] instead of its own: to first order."""
        lower, upper = (limit[np.array(joints)] for limit in (robot.lower, robot.upper))
        margin = _MARGIN * (upper - lower > 4 * _MARGIN)
        nodes: list[Node] = []
        for leaf, rows in ((self.funnel, slice(0, -1)), (self.posture, slice(-1, None))):
            if leaf is not None:
                hands = jnp.asarray(self.hands[rows])
                local = _seen_from(hands, T_before)
                if targets is not None:
                    local = self._retargeted(local, jnp.asarray(targets, local.dtype))
                q = _followed(jnp.asarray(leaf.postures), hands, _placed_at(local, T), self.moves[rows])
                q = jnp.clip(q, jnp.asarray(lower + margin, q.dtype), jnp.asarray(upper - margin, q.dtype))
                nodes.append(replace(leaf, postures=q))
        return on_coordinates(joints, robot.num_joints, Sum(tuple(nodes))) if nodes else Sum(())

    def targets_at(self, offsets: jax.Array, targets: jax.Array) -> jax.Array:
        """Where its points go if the control points at `offsets` go to `targets`, both [K, 3], as one rigid hand."""
        if not self.turned:
            return targets
        a, b = jnp.asarray(offsets), jnp.asarray(targets, jnp.asarray(offsets).dtype)
        R = nearest_rotation(matmul((b - b.mean(0)).T, a - a.mean(0)))
        return matmul(self.offsets - a.mean(0), R.T) + b.mean(0)

    def _retargeted(self, hands: jax.Array, targets: jax.Array) -> jax.Array:
        """Where points [S, P, 3] are that were `hands`, both in the object's frame, if they go to other `targets`."""
        own = jnp.asarray(self.targets, hands.dtype)
        if not self.turned:
            return hands + targets - own
        radius = length(own[0] - own.mean(0))
        middle = hands.mean(1, keepdims=True)
        turns = matmul(jax.vmap(lambda hand: axes_of(hand, radius))(hands), axes_of(own, radius).T)
        new = matmul(targets - targets.mean(0), jnp.swapaxes(turns, 1, 2))
        return middle + targets.mean(0) - own.mean(0) + new

    def with_gains(self, speed: float, damping_rate: float) -> "HandFlow":
        """The same at another cruise `speed`, m/s, and `damping_rate`, 1/s, of the joints' leaves in proportion."""
        hand = {"speed": jnp.asarray(speed, jnp.float32), "damping_rate": jnp.asarray(damping_rate, jnp.float32)}
        joints = hand | {"speed": _PACE * hand["speed"]}
        funnel, posture = (leaf and replace(leaf, **joints) for leaf in (self.funnel, self.posture))
        return replace(self, attractor=replace(self.attractor, **hand), funnel=funnel, posture=posture)


def hand_points(frames: tuple[str, ...], offsets: np.ndarray, circumradius: float) -> tuple[np.ndarray, bool]:
    """Points that stand for the hand: offsets [P, 3] in the first frame, m, and whether they are a triangle.

    Three control points and more on one frame are a rigid hand, whose turn matters, however nearly they lie on a line:
    a triangle around their middle, `triangle_round`, tells it. Else the control points themselves.
    """
    offsets = np.asarray(offsets, float)
    if len(set(frames)) > 1 or len(offsets) < 3 or np.linalg.matrix_rank(offsets - offsets.mean(0), 1e-5) < 2:
        return offsets, False
    return triangle_round(offsets.mean(0), circumradius), True


def triangle_round(middle: np.ndarray, circumradius: float) -> np.ndarray:
    """The corners [3, 3], m, of an equilateral triangle around `middle` [3], across the z axis of its frame."""
    angles = 2 * np.pi / 3 * np.arange(3)
    return np.asarray(middle) + circumradius * np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)


def hand_flow(
    flow: Flow,
    points: tuple[np.ndarray, bool],
    targets: np.ndarray,
    end: np.ndarray,
    settings: FlowSettings,
    policy: PolicySettings,
    **latent: float,
) -> HandFlow:
    """A `HandFlow` of a `flow`; its leaves on the joints are nowhere yet, which `along_ways` mends.

    **Arguments**: `points`, by `hand_points`; their `targets` [P, 3]; `end` [n], where joints end, rad or m;
    `latent`, what else its attractor has other than by default.
    """
    offsets, turned = points
    gains = {"speed": policy.speed, "damping_rate": policy.damping_rate, "weight": settings.weight}
    joints = {"speed": _PACE * policy.speed, "damping_rate": policy.damping_rate}
    radii = {"inner": settings.inner, "onset": settings.onset, "outer": settings.outer}
    nowhere = np.zeros((1, len(end)))
    funnel = Funnel(nowhere, np.zeros(1), settings.funnel, **radii, **joints) if settings.funnel else None
    posture = Funnel(end[None], 0.0, 0.0, settings.posture, **joints, name="posture") if settings.posture else None
    attractor = CruisingAttractor(np.zeros(flow.back.shape[-1]), **gains, **latent, name="learned")
    if turned and flow.back.shape[-1] == 3:
        top = _highest(flow, settings.circumradius, float(attractor.taper))
        attractor = TurnAttractor(top, **gains, **latent, length=settings.circumradius, name="learned")
    moves = np.zeros((2, len(end), offsets.size))
    return HandFlow(flow, attractor, funnel, posture, offsets, targets, np.zeros((2, *offsets.shape)), moves, turned)


def with_flow(motion: HandFlow, flow: Flow, circumradius: float) -> HandFlow:
    """`motion`, in single precision, with another `flow`, round which the attractor of a turn has to be built anew."""
    attractor = motion.attractor
    if isinstance(attractor, TurnAttractor):
        attractor = replace(attractor, top=_highest(flow, circumradius, float(attractor.taper)))
    return single(replace(motion, flow=flow, attractor=attractor))


def _highest(flow: Flow, circumradius: float, taper: float) -> float:
    """The most that the well behind `flow` is, m, on turns about `_AXES` random axes where its coordinates fade."""
    axes = np.random.default_rng(0).normal(size=(_AXES, 3))
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    turns = axes[:, None] * turn_lengths(circumradius, np.linspace(*_FADING, 15))[:, None]
    return float(_wells(single(flow), jnp.asarray(turns.reshape(-1, 3), jnp.float32), taper).max())


@quickly
def _wells(flow: Flow, x: jax.Array, taper: float) -> jax.Array:
    """How high the well of a `CruisingAttractor` behind a flow is at `x` [N, 3], over its gains, m [N]."""
    y = jax.vmap(flow)(x)
    return taper * log_cosh(jnp.sum(y**2, -1) / taper**2)


def along_ways(
    motion: HandFlow,
    robot: Robot,
    frames: tuple[str, ...],
    ways: Sequence[np.ndarray],
    poses: Sequence[np.ndarray],
    T: np.ndarray,
    lead: float,
) -> HandFlow:
    """`motion`, in single precision, with its funnel along `ways`, postures [T, n] each, in the order of motion.

    **Arguments**: `robot` and `frames`, the skill's; `poses`, where the object was on each way [4, 4], and `T`, where
    the skill has it, to which the postures follow it; `lead`, see `FlowSettings`.
    """
    points = ControlPoints(robot, frames[:1] * len(motion.offsets) if motion.turned else frames, motion.offsets)
    followed, left = [], []
    for way, pose in zip(ways, poses, strict=True):
        hands, moves = _hands(points, way, motion.of_turn)
        followed.append(np.asarray(_with_object(*single((way, hands, moves, pose, T))), float))
        steps = np.linalg.norm(np.diff(way, axis=0), axis=1)
        left.append(lead * np.append(np.cumsum(steps[::-1])[::-1], 0.0))
    postures = np.concatenate(followed)
    end = followed[0][-1:] if motion.posture is None else np.asarray(motion.posture.postures, float)
    hands, moves = _hands(points, np.concatenate([postures, end]), motion.of_turn)
    funnel = motion.funnel and replace(motion.funnel, postures=postures, left=np.concatenate(left))
    return single(replace(motion, funnel=funnel, hands=hands, moves=moves))


def _hands(points: ControlPoints, q: np.ndarray, of_turn: bool) -> tuple[np.ndarray, np.ndarray]:
    """Where `points` are [S, P, 3] at `q` [S, n], and damped inverses [S, n, 3 P] of their Jacobians; `of_turn`, of
    those about their middle, so that where they are does not matter."""
    hands, J = by_parts(partial(_carried, points), q, _AT_ONCE)
    J = J - J.mean(1, keepdims=True) if of_turn else J
    J = J.reshape(len(q), -1, q.shape[1])
    A = J @ np.swapaxes(J, 1, 2) + _DAMPING**2 * np.eye(J.shape[1])
    return hands, np.swapaxes(J, 1, 2) @ np.linalg.inv(A)


@quickly
def _carried(points: ControlPoints, q: jax.Array) -> tuple[jax.Array, jax.Array]:
    carried = jax.vmap(lambda q: points.pushforward(q, jnp.zeros_like(q)))(q)
    return carried.y, carried.J


@quickly
def _with_object(q: jax.Array, hands: jax.Array, moves: jax.Array, T_before: jax.Array, T: jax.Array) -> jax.Array:
    return _followed(q, hands, _placed_at(_seen_from(hands, T_before), T), moves)


def _seen_from(points: jax.Array, T: jax.Array) -> jax.Array:
    T = jnp.asarray(T, points.dtype)
    return matmul(points - T[:3, 3], T[:3, :3])


def _placed_at(points: jax.Array, T: jax.Array) -> jax.Array:
    T = jnp.asarray(T, points.dtype)
    return matmul(points, T[:3, :3].T) + T[:3, 3]


def _followed(q: jax.Array, hands: jax.Array, moved: jax.Array, moves: jax.Array) -> jax.Array:
    """Postures `q` [S, n] after their `hands` went to `moved`, both [S, P, 3]: to first order, by `moves`, and no
    farther than that can be believed, which near a singularity is not far."""
    steps = einsum("sij,sj->si", moves, (moved - hands).reshape(len(q), -1))
    far = jnp.sqrt(jnp.maximum(jnp.sum(steps**2, -1, keepdims=True), _FARTHEST**2))
    return q + steps * (_FARTHEST / far)
