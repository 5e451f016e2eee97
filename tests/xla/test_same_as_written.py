"""In batches, the machinery gives what the mathematics as written gives, values and gradients: every leaf and map."""

import json
import os
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial

import jaxrmp
from jaxrmp import (
    Batched,
    GeometricDynamicalSystem,
    Leaf,
    TaskMap,
    acceleration,
    compose,
    pullback,
    resolve,
    stack,
    transport,
)
from jaxrmp.io import load_lula
from jaxrmp.io._axes_and_position import AxesAndPosition
from jaxrmp.kinematics import ControlPoints, FrameAxes, FrameRotation, PointsInFrame, Position, RelativePoints, panda
from jaxrmp.leaves import (
    Attractor,
    CollisionAvoidance,
    Damping,
    Formation,
    JointLimit,
    JointVelocityLimit,
    Learned,
    NominalPotential,
    OrientationAttractor,
    Posture,
    StretchedAttractor,
    lula,
)
from jaxrmp.simulation import Held
from jaxrmp.viewer._push import Push
from jaxrmp.world import Boxes, CapsuleDistances, ObstacleDistances, SelfDistances, Spheres, World
from jaxrmp.xla import in_lanes, machinery, report
from jaxrmp.xla._plan import FEWEST

MANY = FEWEST + 2  # states, a number that is no power of two
RNG = np.random.default_rng(0)
ROBOT = panda()
LOWER, UPPER = -np.arange(2.0, 5.0), np.arange(2.0, 5.0)
HAND = ControlPoints(ROBOT, ("panda_link3", "panda_link2"), np.array([[0.0, 0.1, 0.05], [0.0, 0.0, 0.1]]))
POINTS = lambda x: jnp.stack([jnp.sin(x), jnp.cos(x), x * x[::-1]])  # noqa: E731
SCENE = World(spheres=Spheres.of([((0.4, 0.1, 0.3), 0.1)]), boxes=Boxes.of([(np.eye(4), [0.1, 0.2, 0.3])]))
POTENTIAL = NominalPotential(RNG.normal(size=(5, 3)), np.arange(5.0)[::-1].copy(), np.ones(3) / 10, 0.5, 5.0)


def state_metric(x, xd):
    return (1 + x @ x) * jnp.eye(3)


def factor(x):
    return jnp.eye(3) + jnp.tril(jnp.outer(jnp.sin(x), jnp.cos(x))) / 4


SYSTEM = GeometricDynamicalSystem.of(state_metric, lambda x: x @ x, state_metric)

# An example of each: the node or map, and the shape of its states.
LEAVES = {
    type(SYSTEM): (SYSTEM, (3,)),
    Attractor: (Attractor(np.ones(3)), (3,)),
    CollisionAvoidance: (CollisionAvoidance(reach=2.0, frequency=20.0), (3,)),
    Damping: (Damping(), (3,)),
    Formation: (Formation(), (3,)),
    Held: (Held(jaxrmp.NaturalForm(np.ones(3), np.eye(3))), (3,)),
    JointLimit: (JointLimit(LOWER, UPPER), (3,)),
    JointVelocityLimit: (JointVelocityLimit(1.5), (3,)),
    Learned: (Learned(POTENTIAL, Partial(factor)), (3,)),
    OrientationAttractor: (pullback(FrameRotation(ROBOT, "panda_link3"), OrientationAttractor(np.eye(3))), (7,)),
    Posture: (Posture(np.ones(3)), (3,)),
    Push: (Push(np.ones(3), 2.0, 0.5), (3,)),
    StretchedAttractor: (StretchedAttractor(np.ones(3)), (3,)),
    lula.AxisTarget: (lula.AxisTarget(np.eye(3)[0]), (3,)),
    lula.Collision: (lula.Collision(), (3,)),
    lula.CSpaceTarget: (lula.CSpaceTarget(np.ones(3)), (3,)),
    lula.Inertia: (lula.Inertia(), (3,)),
    lula.JointLimit: (lula.JointLimit(LOWER, UPPER), (3,)),
    lula.JointVelocityCap: (lula.JointVelocityCap(), (3,)),
    lula.PositionTarget: (lula.PositionTarget(np.ones(3)), (3,)),
    lula.SpeedDamping: (lula.SpeedDamping(), (3,)),
}
MAPS = {
    jaxrmp.Identity: (jaxrmp.Identity(), (3,)),
    jaxrmp.Selection: (jaxrmp.Selection((2, 0)), (3,)),
    jaxrmp.Affine: (jaxrmp.Affine(RNG.normal(size=(2, 3)), np.ones(2)), (3,)),
    jaxrmp.RigidTransform: (jaxrmp.RigidTransform(np.eye(4)), (2, 3)),
    jaxrmp.Translation: (jaxrmp.Translation(np.ones(3)), (3,)),
    jaxrmp.Distance: (jaxrmp.Distance(np.ones(3), 0.1), (3,)),
    jaxrmp.Composition: (compose(jaxrmp.Translation(np.ones(3)), jaxrmp.Distance(np.zeros(3))), (3,)),
    jaxrmp.Stack: (stack(jaxrmp.Selection((0,)), jaxrmp.Distance(np.zeros(3))), (3,)),
    jaxrmp.Pointwise: (jaxrmp.Pointwise(jaxrmp.Distance(np.zeros(3))), (2, 3)),
    ControlPoints: (HAND, (7,)),
    FrameAxes: (FrameAxes(ROBOT, "panda_link3"), (7,)),
    FrameRotation: (FrameRotation(ROBOT, "panda_link3"), (7,)),
    Position: (Position(ROBOT, "panda_link3"), (7,)),
    RelativePoints: (RelativePoints(POINTS, jnp.sin), (3,)),
    PointsInFrame: (PointsInFrame(ROBOT, "panda_link3", HAND), (7,)),
    AxesAndPosition: (AxesAndPosition(ROBOT, "panda_link3"), (7,)),
    ObstacleDistances: (ObstacleDistances(HAND, SCENE, 0.05), (7,)),
    CapsuleDistances: (CapsuleDistances(HAND, HAND, SCENE, 0.05), (7,)),
    SelfDistances: (SelfDistances(HAND, ((0, 1),), 0.05), (7,)),
}


def kinds(base):
    """All classes below a base that the library can make instances of, as its users meet them."""
    for kind in base.__subclasses__():
        if kind.__module__.startswith("jaxrmp.") and "__dataclass_fields__" in vars(kind):
            yield kind
        yield from kinds(kind)


@pytest.mark.parametrize(("base", "examples"), [(Leaf, LEAVES), (TaskMap, MAPS)])
def test_every_leaf_and_map_has_an_example_here(base, examples):
    missing = {kind.__name__ for kind in kinds(base)} - {kind.__name__ for kind in examples}
    assert not missing, f"give an example of {sorted(missing)}, so that it is compared with what is written"


def of_leaf(leaf, x, xd):
    form = leaf(x, xd)
    return form.f, form.M


def of_map(psi, x, xd):
    there = transport(psi, x, xd)
    J = jnp.cos(jnp.arange(there.y.size, dtype=x.dtype)).reshape(there.y.shape)
    ones = jnp.ones(there.y.shape, x.dtype)
    eye = jnp.eye(there.y.shape[-1], dtype=x.dtype)
    forms = jaxrmp.NaturalForm(J, ones[..., None] * 2 * eye), jaxrmp.DiagonalForm(J, 2 + ones)
    return there.y, there.yd, [(form.f, form.M) for form in (there.pull(form).dense() for form in forms)]


def values(function, *states):
    return function(*states)


def slopes(function, *states):
    """Along a direction of the positions. What is differentiated is not taken apart."""
    *others, x, xd = states
    return jax.jvp(lambda x: function(*others, x, xd), (x,), (jax.tree.map(lambda x: jnp.cos(3 * x), x),))[1]


def lanes(function, *states):
    """By C, where there is a compiler."""
    return in_lanes(function)(*states)


WHAT = pytest.mark.parametrize("of", [values, slopes, lanes])


def both(function, *states, in_axes=0):
    """What a batch gives by the machinery, and as written."""
    options = {"xla_backend_optimization_level": 0, "xla_disable_hlo_passes": "fusion"}  # half the time and memory
    many = jax.jit(jax.vmap(function, in_axes), compiler_options=options)
    with machinery(False):
        expected = many(*states)
    return many(*states), expected


def assert_same(found, expected, rtol, name=""):
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert np.isfinite(b).all()
        np.testing.assert_allclose(a, b, rtol=rtol, atol=rtol * np.abs(b).max(initial=1), err_msg=name)


def states(batch, shape):
    return 0.9 * RNG.uniform(-1, 1, (batch, *shape)) + 0.1, RNG.normal(size=(batch, *shape))


@WHAT
def test_every_leaf(of, x64):
    def all_of_them(x, xd):
        return [of(partial(of_leaf, leaf), x[n], xd[n]) for n, (leaf, _) in enumerate(LEAVES.values())]

    x, xd = zip(*(states(MANY, shape) for _, shape in LEAVES.values()), strict=True)
    for kind, found, expected in zip(LEAVES, *both(all_of_them, x, xd), strict=True):
        assert_same(found, expected, 1e-9, kind.__name__)


@WHAT
@pytest.mark.parametrize("kind", MAPS, ids=lambda kind: kind.__name__)
def test_every_map(kind, of, x64):
    psi, shape = MAPS[kind]
    assert_same(*both(partial(of, partial(of_map, psi)), *states(MANY, shape)), 1e-9)


def tree_24_pairs(goal):
    frames = (*(f"panda_link{i}" for i in range(3, 8)), "panda_hand")
    obstacles = World(spheres=Spheres.of([((0.45, 0.1, 0.55), 0.08), ((0.3, 0.3, 0.25), 0.08)] * 2))
    tree = pullback(ControlPoints(ROBOT, ("panda_hand",)), Batched(Attractor(goal), shared=True))
    tree += pullback(ObstacleDistances(ControlPoints(ROBOT, frames), obstacles, 0.08), CollisionAvoidance(reach=0.5))
    return tree + JointLimit(ROBOT.lower, ROBOT.upper) + Damping()


def policy_24_pairs(goal, q, qd):
    return acceleration(tree_24_pairs(goal), q, qd)


def arm_states(batch):
    middle = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    return middle + 0.2 * RNG.normal(size=(batch, 7)), 0.3 * RNG.normal(size=(batch, 7))


PARTS = {
    "ControlPoints._motions",
    "ControlPoints.transport.pull",
    "JointLimit.evaluate",
    "CollisionAvoidance.evaluate",
    "Damping.evaluate",
    "_solve_by_cholesky",
}


@WHAT
def test_whole_policy_of_24_pairs(of, x64):
    arguments = np.array([0.45, 0.35, 0.45]), *arm_states(MANY)
    assert_same(*both(partial(of, policy_24_pairs), *arguments, in_axes=(None, 0, 0)), 1e-7)


def test_what_should_be_taken_apart_is():
    example = np.zeros(3, np.float32), np.zeros(7, np.float32), np.zeros(7, np.float32)
    (whole,) = report(policy_24_pairs, *example, batch=FEWEST, in_axes=(None, 0, 0))
    assert whole.name == "acceleration" and whole.taken_apart

    def in_loops(goal, q, qd):  # as where there is no C compiler
        return resolve(tree_24_pairs(goal)(q, qd))

    parts = report(in_loops, *example, batch=FEWEST, in_axes=(None, 0, 0))
    assert {part.name for part in parts} >= PARTS
    assert [part for part in parts if not part.taken_apart] == []
    assert max(part.operations for part in parts) <= 3000 < sum(part.operations for part in parts)
    few = report(in_loops, *example, batch=FEWEST - 1, in_axes=(None, 0, 0))
    assert {part.reason for part in few} == {f"a batch of {FEWEST - 1} < {FEWEST} states"}


def test_many_coordinates_are_taken_apart_one_by_one_where_they_are_alike():
    n = 500
    leaf = JointLimit(-np.ones(n) - np.arange(n) / n, np.ones(n), weight=jnp.arange(1.0, n + 1))
    (part,) = report(leaf.evaluate, np.zeros(n), np.zeros(n), batch=FEWEST)
    assert part.taken_apart and part.operations % n == 0
    x, xd = (a.astype(np.float32) for a in states(FEWEST, (n,)))
    found = jax.jit(jax.vmap(leaf.evaluate))(x, xd)
    with machinery(False):
        expected = jax.jit(jax.vmap(leaf.evaluate))(x, xd)
    assert_same(found, expected, 1e-4)


@WHAT
def test_a_skill(of, x64):
    keys = jax.random.split(jax.random.key(0), 2)
    learned = pytest.importorskip("jaxrmp.learning._metric_network")
    factors = jax.vmap(lambda key: learned.initial_cholesky_factor(key, hidden=(16, 8), length_scale=0.1))(keys)
    stacked = jax.tree.map(lambda a: jnp.stack([jnp.asarray(a)] * 2), POTENTIAL)
    leaves = Batched(Learned(stacked, factors, jnp.full(2, 0.2), jnp.full(2, 40.0)))

    def policy(T, q, qd):
        tree = pullback(compose(HAND, jaxrmp.RigidTransform(T)), leaves)
        return acceleration(tree + JointLimit(ROBOT.lower, ROBOT.upper) + Damping(), q, qd)

    assert_same(*both(partial(of, policy), np.eye(4), *arm_states(MANY), in_axes=(None, 0, 0)), 1e-5)


@WHAT
def test_lula(of, x64):
    folder = Path(os.environ.get("JAXRMP_DATA") or os.devnull) / "lula"
    if not folder.is_dir():
        pytest.skip("needs NVIDIA's files: set JAXRMP_DATA to the folder that holds lula/")
    golden = json.loads((folder / "golden_franka.json").read_text())
    loaded = load_lula(*(folder / golden[name] for name in ("urdf", "xrdf", "config")))

    def policy(target, q, qd):
        posture = np.array(golden["cspace_attractor"])
        tree = loaded.tree(frame=golden["frame"], position_target=target, cspace_target=posture, world=SCENE)
        return loaded.acceleration(tree, q, qd)

    arguments = np.array(golden["position_target"]), *arm_states(MANY)
    assert_same(*both(partial(of, policy), *arguments, in_axes=(None, 0, 0)), 1e-6)


def test_the_switch_keeps_programs_apart():
    x = np.ones((FEWEST, 3), np.float32)
    many = jax.jit(jax.vmap(Posture(np.zeros(3)).evaluate))

    def text():
        return many.lower(x, x).as_text()

    with machinery(False):
        off = text()
        many(x, x)
        with machinery(True):
            assert text() != off
    assert text() != off
    assert many._cache_size() == 1
    many(x, x)
    assert many._cache_size() == 2


def test_what_is_given_up_says_why(caplog):
    (part,) = report(jaxrmp.xla.one_loop(jnp.sort), np.zeros(3), batch=FEWEST)
    assert not part.taken_apart and part.reason == "holds `sort`"
    with caplog.at_level("INFO", "jaxrmp.xla"):
        call = jaxrmp.compiled(jnp.linalg.pinv, np.eye(2, dtype=np.float32))
    assert not call.one_kernel and call.reason and call.reason in caplog.text
    with machinery(False):
        assert "off" in jaxrmp.compiled(jnp.sin, np.ones(2)).reason
