"""An example of every leaf and map, for the tests that ask something of all of them."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jax.tree_util import Partial

import jaxrmp
from jaxrmp import Batched, GeometricDynamicalSystem, compose, pullback, stack, transport
from jaxrmp.io._axes_and_position import AxesAndPosition
from jaxrmp.kinematics import ControlPoints, FrameAxes, FrameRotation, PointsInFrame, Position, RelativePoints, panda
from jaxrmp.learning import initial_flow
from jaxrmp.learning._flow import Flow
from jaxrmp.learning._hand_maps import AboutMiddle, BeyondTurn, HandPose, HandTurn, Stacked
from jaxrmp.learning._turn_attractor import TurnAttractor
from jaxrmp.leaves import (
    Attractor,
    CollisionAvoidance,
    CruisingAttractor,
    Damping,
    Detour,
    DirectionAttractor,
    Formation,
    Funnel,
    JointLimit,
    JointVelocityLimit,
    Learned,
    NominalPotential,
    OrientationAttractor,
    Posture,
    StretchedAttractor,
    lula,
)
from jaxrmp.policies import upright
from jaxrmp.policies._detour import _Ahead, _Point
from jaxrmp.simulation import Held
from jaxrmp.viewer._push import Push
from jaxrmp.world import Boxes, CapsuleDistances, ObstacleDistances, SelfDistances, Spheres, World

RNG = np.random.default_rng(0)
ROBOT = panda()
LOWER, UPPER = -np.arange(2.0, 5.0), np.arange(2.0, 5.0)
HAND = ControlPoints(ROBOT, ("panda_link3", "panda_link2"), np.array([[0.0, 0.1, 0.05], [0.0, 0.0, 0.1]]))
POINTS = lambda x: jnp.stack([jnp.sin(x), jnp.cos(x), x * x[::-1]])  # noqa: E731
SCENE = World(spheres=Spheres.of([((0.4, 0.1, 0.3), 0.1)]), boxes=Boxes.of([(np.eye(4), [0.1, 0.2, 0.3])]))
POTENTIAL = NominalPotential(RNG.normal(size=(5, 3)), np.arange(5.0)[::-1].copy(), np.ones(3) / 10, 0.5, 5.0)


FLOW = initial_flow(0, 4, couplings=3, hidden=5, length=0.5)
FLOW = replace(FLOW, couplings=replace(FLOW.couplings, weights_3=RNG.normal(size=(3, 4, 5)) / 5)).centred()


def state_metric(x, xd):
    return (1 + jnp.sum(x * x)) * jnp.eye(3)


def factor(x):
    return jnp.eye(3) + jnp.tril(jnp.outer(jnp.sin(x), jnp.cos(x))) / 4


SYSTEM = GeometricDynamicalSystem.of(state_metric, lambda x: jnp.sum(x * x), state_metric)

# An example of each: the node or map, and the shape of its states.
LEAVES = {
    type(SYSTEM): (SYSTEM, (3,)),
    Attractor: (Attractor(np.ones(3)), (3,)),
    CruisingAttractor: (CruisingAttractor(np.ones(3), taper=0.5), (3,)),
    TurnAttractor: (TurnAttractor(1.5, taper=0.5), (4,)),
    CollisionAvoidance: (CollisionAvoidance(reach=2.0, frequency=20.0), (3,)),
    Damping: (Damping(), (3,)),
    Detour: (Detour(2.0, reach=2.0, taper=0.5), (5,)),
    DirectionAttractor: (upright(ROBOT, "panda_link3"), (7,)),
    Formation: (Formation(), (3,)),
    Funnel: (Funnel(RNG.normal(size=(5, 3)), within=0.1, inner=0.2, outer=3.0), (3,)),
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
HANDS = (HandPose, HandTurn, BeyondTurn)
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
    Flow: (FLOW, (4,)),
    Stacked: (Stacked(HAND), (7,)),
    AboutMiddle: (AboutMiddle(HAND), (7,)),
    **{kind: (kind(jnp.asarray([[0.1, 0, 0], [-0.05, 0.0866, 0], [-0.05, -0.0866, 0]])), (9,)) for kind in HANDS},
    Position: (Position(ROBOT, "panda_link3"), (7,)),
    RelativePoints: (RelativePoints(POINTS, jnp.sin), (3,)),
    PointsInFrame: (PointsInFrame(ROBOT, "panda_link3", HAND), (7,)),
    AxesAndPosition: (AxesAndPosition(ROBOT, "panda_link3"), (7,)),
    ObstacleDistances: (ObstacleDistances(HAND, SCENE, 0.05), (7,)),
    _Ahead: (_Ahead(np.ones(3), np.array([0.1, 0.0, 0.2]), SCENE), (3,)),
    _Point: (_Point(ControlPoints(ROBOT, ("panda_link3",), np.array([[0.0, 0.1, 0.05]]))), (7,)),
    CapsuleDistances: (CapsuleDistances(HAND, HAND, SCENE, 0.05), (7,)),
    SelfDistances: (SelfDistances(HAND, ((0, 1),), 0.05), (7,)),
}


def kinds(base):
    """All classes below a base that the library can make instances of, as its users meet them."""
    for kind in base.__subclasses__():
        if kind.__module__.startswith("jaxrmp.") and "__dataclass_fields__" in vars(kind):
            yield kind
        yield from kinds(kind)


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


def tree_24_pairs(goal):
    frames = (*(f"panda_link{i}" for i in range(3, 8)), "panda_hand")
    obstacles = World(spheres=Spheres.of([((0.45, 0.1, 0.55), 0.08), ((0.3, 0.3, 0.25), 0.08)] * 2))
    tree = pullback(ControlPoints(ROBOT, ("panda_hand",)), Batched(Attractor(goal), shared=True))
    tree += pullback(ObstacleDistances(ControlPoints(ROBOT, frames), obstacles, 0.08), CollisionAvoidance(reach=0.5))
    return tree + JointLimit(ROBOT.lower, ROBOT.upper) + Damping()
