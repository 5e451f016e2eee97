"""Evaluations a second in batches, and how the cost grows with leaves, obstacles, degrees of freedom and batch."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp import Batched, Node, acceleration, batched, pullback
from jaxrmp.kinematics import ControlPoints, panda
from jaxrmp.leaves import Attractor, Damping, JointLimit
from jaxrmp.world import Spheres

from ._chains import serial_arms
from ._plots import curves
from ._policies import GOAL, POSTURE, SPHERES, among_spheres, learned_drawer, on_device, panda_24_pairs, states
from ._timing import alternately

BATCHES = (1, 4, 16, 64, 256, 1024, 4096, 16384, 65536)
LEAVES, OBSTACLES, JOINTS = (4, 8, 16, 32, 64), (8, 16, 32, 64, 128, 256, 512), (7, 14, 30)
SEPARATE = (2, 4, 8)  # nodes of their own: compiling more takes minutes
SCALING_BATCH = 256
AT_ONCE = 1024  # of a larger batch, what is worked on at once: what lies between stays in the caches
AT_ONCE_SCALING = 64  # the same where policies are up to a hundred times as large
LINEAR = 1.05  # exponents up to here count as linear: a twentieth for what timing leaves open


def rows(quick: bool = False) -> list[dict[str, Any]]:
    """Rows of `family`, `size`, and what one evaluation takes: in a batch, and as a single call from Python.

    On a CPU, batches are mapped by `jax.lax.map` with 1,024 states at once, which for up to 1,024 is `vmap`, and those
    that grow in other ways with 64.

    Then one row a family: with which power of the size the cost grows, from the second size on.
    """
    found = []
    policies = {"panda_24_pairs": panda_24_pairs()} | ({} if quick else {"learned_drawer": learned_drawer()})
    for name, policy in policies.items():
        family = f"batch, {name}"
        taken = _family(
            {B: (on_device(policy.moving), policy, B, 7) for B in (BATCHES[:3] if quick else BATCHES)}, quick
        )
        found += [_row(family, B, us / B, "us_per_evaluation") for B, us in taken.items()]
        found.append(_growth(family, {B: us for B, us in taken.items() if B >= 256 or quick}))
    for family, make, sizes in () if quick else FAMILIES:
        trees = {size: on_device(make(size)) for size in sizes}
        joints = {size: size if sizes is JOINTS else 7 for size in trees}
        for batch, column in ((SCALING_BATCH, "us_per_evaluation"), (1, "call_us")):
            taken = _family({s: (tree, acceleration, batch, joints[s]) for s, tree in trees.items()}, quick)
            kind = "batch of 256, 64 at a time" if batch > 1 else "single call"
            found += [_row(f"{family}, {kind}", s, us / batch, column) for s, us in taken.items()]
            found.append(_growth(f"{family}, {kind}", taken))
    return found


def figure(found: list[dict[str, Any]]) -> Any:
    """Cost of an evaluation in a batch against the size of everything."""
    series: dict[str, tuple[list, list]] = {}
    for row in found:
        if row.get("us_per_evaluation"):
            at, values = series.setdefault(row["name"], ([], []))
            at.append(row["size"])
            values.append(row["us_per_evaluation"])
    return curves(series, "size", "microseconds an evaluation")


def separate_leaves(count: int) -> Node:
    """That many attractors, each a node of its own on a point of its own on the arm."""
    robot, frames = panda(), tuple(SPHERES)
    tree: Any = JointLimit(robot.lower, robot.upper) + Damping()
    for i in range(count):
        point = ControlPoints(robot, frames[i % len(frames)], _offset(i)[None])
        tree = tree + pullback(point, Batched(Attractor(_goal(i)), shared=True))
    return tree


def batched_leaves(count: int) -> Node:
    """The same attractors as one batched node."""
    robot, frames = panda(), tuple(SPHERES)
    names = tuple(frames[i % len(frames)] for i in range(count))
    points = ControlPoints(robot, names, np.stack([_offset(i) for i in range(count)]))
    leaves = batched(*(Attractor(_goal(i)) for i in range(count)))
    return pullback(points, leaves) + JointLimit(robot.lower, robot.upper) + Damping()


def obstacles(count: int) -> Node:
    """The scene of 24 pairs with that many obstacle spheres, the arm's six against each."""
    return among_spheres(panda(), ("panda_hand",), tuple(SPHERES), list(SPHERES.values()), _spheres(count))


def degrees_of_freedom(joints: int) -> Node:
    """A serial arm of that many joints with a goal, its limits, and six spheres against four obstacles."""
    links = tuple(f"arm0_link{round(i * joints / 6)}" for i in range(1, 7))
    return among_spheres(serial_arms(joints), links[-1:], links, [0.05] * 6, _spheres(4))


def three_arms(joints: int) -> Node:
    """The same joints shared out among three arms, each with two of the spheres, and the goal."""
    each = [(joints + k) // 3 for k in range(3)]
    links = tuple(f"arm{k}_link{i}" for k, n in enumerate(each) for i in (n // 2, n))
    return among_spheres(serial_arms(*each), links[1::2], links, [0.05] * 6, _spheres(4))


FAMILIES = (
    ("leaves, batched", batched_leaves, LEAVES),
    ("obstacles", obstacles, OBSTACLES),
    ("degrees of freedom", degrees_of_freedom, JOINTS),
    ("degrees of freedom, three arms", three_arms, JOINTS),
    ("leaves, one node each", separate_leaves, SEPARATE),
)


def _spheres(count: int) -> Spheres:
    rng = np.random.default_rng(0)
    centers = rng.normal(size=(count, 3))
    centers *= 0.9 / np.linalg.norm(centers, axis=1, keepdims=True)
    return Spheres.of([(center + [0, 0, 0.4], 0.05) for center in centers])


def _offset(i: int) -> np.ndarray:
    return 0.05 * np.sin(np.array([1.0, 2.0, 3.0]) * (i + 1))


def _goal(i: int) -> np.ndarray:
    return np.array(GOAL) + 0.1 * np.cos(np.array([1.0, 2.0, 3.0]) * i)


def _family(cases: dict[int, tuple[Any, Callable, int, int]], quick: bool) -> dict[int, float]:
    """Microseconds a call of every case (tree, function, batch, joints), which take turns."""
    calls = {str(size): _call(*case) for size, case in cases.items()}
    taken = alternately(calls, rounds=2 if quick else 11, least=0.0 if quick else 0.05)
    return {size: float(np.median(taken[str(size)])) for size in cases}


def _call(tree: Any, evaluate: Callable, batch: int, joints: int) -> Callable[[], Any]:
    Q, QD = (jnp.asarray(a) for a in states(batch, joints, POSTURE if joints == 7 else np.full(joints, 0.1)))
    if batch == 1:
        one, q, qd = jax.jit(evaluate), Q[0], QD[0]
        return lambda: one(tree, q, qd).block_until_ready()
    at_once = batch
    if jax.default_backend() == "cpu":
        at_once = AT_ONCE_SCALING if evaluate is acceleration else AT_ONCE
    many = jax.jit(lambda tree, q, qd: jax.lax.map(lambda state: evaluate(tree, *state), (q, qd), batch_size=at_once))
    return lambda: many(tree, Q, QD).block_until_ready()


def _row(family: str, size: int, us: float, column: str) -> dict[str, Any]:
    return {"name": family, "size": size, column: us, **({"per_second": 1e6 / us} if column != "call_us" else {})}


def _growth(family: str, taken: dict[int, float]) -> dict[str, Any]:
    """The exponent of a straight line through the logarithms, from the second size on, and of the steepest step."""
    sizes, times = np.log(list(taken)[1:]), np.log(list(taken.values())[1:])
    if len(sizes) < 2:
        return {"name": f"growth: {family}", "verdict": "too few sizes"}
    exponent = float(np.polyfit(sizes, times, 1)[0])
    steepest = float(np.max(np.diff(times) / np.diff(sizes)))
    verdict = "no worse than linear" if exponent <= LINEAR else "worse than linear"
    return {"name": f"growth: {family}", "exponent": exponent, "steepest_step": steepest, "verdict": verdict}
