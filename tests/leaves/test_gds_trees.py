"""Random trees of every certified hand-designed leaf keep the certificate."""

import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial

from jaxrmp import Batched, Distance, Pointwise, batched, compose, pullback
from jaxrmp.kinematics import ControlPoints, FrameRotation, PointsInFrame, RelativePoints, panda
from jaxrmp.leaves import (
    Attractor,
    CollisionAvoidance,
    Damping,
    Formation,
    JointLimit,
    OrientationAttractor,
    Posture,
    StretchedAttractor,
)

pytestmark = pytest.mark.usefixtures("x64")
FRAMES = ("panda_hand", "panda_link4", "panda_link6")


def spheres(centers, radii, points):
    return (jnp.linalg.norm(points[:, None] - centers, axis=-1) - radii).reshape(-1)


@pytest.mark.parametrize("seed", range(3))
def test_random_trees_on_the_panda(seed, assert_certified):
    rng = np.random.default_rng(seed)
    robot = panda()
    points = ControlPoints(robot, FRAMES, rng.uniform(-0.1, 0.1, (3, 3)))
    hand = ControlPoints(robot, ("panda_hand",))
    obstacles = Partial(spheres, jnp.asarray(rng.uniform(-1, 1, (4, 3))), jnp.asarray(rng.uniform(0.05, 0.3, 4)))
    distances = Partial(lambda points, obstacles, q: obstacles(points(q)), points, obstacles)
    every = [
        pullback(points, batched(*(Attractor(g, gain=rng.uniform(0.5, 3)) for g in rng.uniform(-0.6, 0.6, (3, 3))))),
        pullback(hand, batched(StretchedAttractor(rng.uniform(-0.6, 0.6, 3), floor=0.1))),
        pullback(
            PointsInFrame(robot, "panda_link4", hand), batched(Attractor(rng.uniform(-0.3, 0.3, 3), sharpness=9.0))
        ),
        pullback(distances, CollisionAvoidance(barrier=1e-3, reach=0.4, damping_rate=rng.uniform(0, 2))),
        pullback(FrameRotation(robot, "panda_hand"), OrientationAttractor(jnp.eye(3), rounding=rng.uniform(0.05, 1))),
        pullback(
            compose(RelativePoints(hand, ControlPoints(robot, "panda_link2")), Pointwise(Distance(jnp.zeros(3), 0.3))),
            Batched(Formation(gain=4.0), shared=True),
        ),
        Posture(rng.uniform(-1, 1, 7), weight=rng.uniform(0.01, 0.1, 7)),
        JointLimit(jnp.asarray(robot.lower), jnp.asarray(robot.upper), weight=0.5, sigma=0.3),
    ]
    chosen = every if seed == 0 else [every[i] for i in rng.choice(len(every), 5, replace=False)]
    tree = Damping(0.1, 1.0)
    for node in chosen:
        tree = tree + node
    assert_certified(tree, rng.uniform(robot.lower, robot.upper, (1000, 7)), rng.normal(size=(1000, 7)))
