"""Every product of the library states its precision, so that an accelerator does not round it to TF32 or bfloat16."""

import os
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.extend.core import ClosedJaxpr, Jaxpr
from jax.lax import Precision

from jaxrmp import acceleration, certificate, overdamped_velocity, velocity
from jaxrmp._linalg import matmul
from jaxrmp.inspection import inspect
from jaxrmp.io import load_lula
from jaxrmp.kinematics import ControlPoints
from jaxrmp.policies import reaching_policy, whole_arm_policy
from jaxrmp.simulation import rollout
from jaxrmp.world import SelfDistances, World
from jaxrmp.xla import in_lanes

from .examples import LEAVES, MAPS, ROBOT, SCENE, of_leaf, of_map, tree_24_pairs

STATED = (Precision.HIGHEST, Precision.HIGHEST)
Q, QD = np.linspace(-0.5, 0.4, 7, dtype=np.float32), np.linspace(0.1, 0.2, 7, dtype=np.float32)


def equations(value):
    """All equations of a jaxpr, and of those in the parameters of its equations."""
    if isinstance(value, ClosedJaxpr | Jaxpr):
        for equation in value.eqns:
            yield equation
            yield from equations(tuple(equation.params.values()))
    elif isinstance(value, tuple | list):
        for item in value:
            yield from equations(item)
    elif isinstance(value, partial):
        yield from equations((*value.args, *value.keywords.values()))


def products(function, *arguments):
    """The precisions of all products in a function, traced by a caller who asks for the lowest."""
    with jax.default_matmul_precision("bfloat16"):
        found = jax.make_jaxpr(function)(*arguments)
    names = ("dot_general", "conv_general_dilated")
    return [e.params["precision"] for e in equations(found) if e.primitive.name in names]


def value(function, *arguments):
    return function(*arguments)


def pulled(function, *arguments):
    found, back = jax.vjp(function, *arguments)
    return back(found)


def slopes(function, *arguments):
    """The gradient of a derivative: what autodiff makes of products, forward and in reverse."""
    return pulled(lambda *a: jax.jvp(function, a, a), *arguments)


def many(function, *arguments):
    return jax.vmap(in_lanes(function))(*(jnp.stack([jnp.asarray(a)] * 5) for a in arguments))


WAYS = (many, slopes)


def all_stated(function, *arguments, ways=WAYS):
    found = {way.__name__: products(partial(way, function), *arguments) for way in ways}
    assert {name: set(p) - {STATED} for name, p in found.items()} == {way.__name__: set() for way in ways}
    return sum(map(len, found.values()))


def of_shape(shape):
    return np.linspace(0.1, 0.7, int(np.prod(shape)), dtype=np.float32).reshape(shape)


def test_the_walk_sees_products_wherever_they_are():
    """Otherwise nothing below would say anything."""
    x = jnp.eye(3)
    open_, stated = (lambda x: x @ x), partial(matmul, x)
    for hidden in (
        jax.jit(open_),
        in_lanes(open_),
        lambda x: jax.lax.scan(lambda c, _: (open_(c), None), x, length=2),
        lambda x: jax.lax.while_loop(lambda c: c[0, 0] < 1, open_, x),
        lambda x: jax.lax.cond(x[0, 0] < 1, open_, stated, x),
        jax.checkpoint(open_),
        partial(slopes, open_),
        lambda x: jnp.linalg.norm(jnp.linalg.pinv(x) @ x),
    ):
        assert set(products(hidden, x)) - {STATED}, hidden
    assert set(products(stated, x)) == {STATED}


@pytest.mark.parametrize("kind", LEAVES, ids=lambda kind: kind.__name__)
def test_every_leaf(kind):
    leaf, shape = LEAVES[kind]
    x = of_shape(shape)
    all_stated(partial(of_leaf, leaf), x, x)
    all_stated(leaf.measure, x, x, ways=(value,))
    all_stated(
        lambda leaf: of_leaf(leaf, x, x), jax.tree.map(lambda a: np.asarray(a, np.float32), leaf), ways=(pulled,)
    )


@pytest.mark.parametrize("kind", MAPS, ids=lambda kind: kind.__name__)
def test_every_map(kind):
    psi, shape = MAPS[kind]
    x = of_shape(shape)
    all_stated(lambda x: (psi(x), psi.pushforward(x, x)), x, ways=(value,))
    all_stated(partial(of_map, psi), x, x)


def arm(tree):
    return partial(acceleration, tree)


POLICIES = {
    "24 pairs": lambda: arm(tree_24_pairs(np.ones(3, np.float32))),
    "24 pairs, lu": lambda: partial(acceleration, tree_24_pairs(np.ones(3)), method="lu"),
    "24 pairs, pinv": lambda: partial(acceleration, tree_24_pairs(np.ones(3)), method="pinv"),
    "certificate": lambda: partial(certificate, tree_24_pairs(np.ones(3))),
    "inspection": lambda: partial(inspect, tree_24_pairs(np.ones(3))),
    "first order": lambda: lambda q, qd: velocity(tree_24_pairs(np.ones(3)), q),
    "overdamped": lambda: lambda q, qd: overdamped_velocity(tree_24_pairs(np.ones(3)), q),
    "reaching": lambda: arm(reaching_policy(ROBOT, "panda_hand").tree(np.eye(4), SCENE)),
}


@pytest.mark.parametrize("name", POLICIES)
def test_every_policy(name):
    assert all_stated(POLICIES[name](), Q, QD, ways=(many, pulled)) > 0


def test_a_skill_on_the_whole_arm(drawer_skill):
    tree = jax.tree.map(jnp.asarray, whole_arm_policy(drawer_skill, ROBOT).tree(np.eye(4, dtype=np.float32), SCENE))
    assert all_stated(partial(acceleration, tree), Q, QD, ways=(many, pulled)) > 0


def test_lula():
    folder = Path(os.environ.get("JAXRMP_DATA") or os.devnull) / "lula"
    if not folder.is_dir():
        pytest.skip("needs NVIDIA's files: set JAXRMP_DATA to the folder that holds lula/")
    loaded = load_lula(folder / "franka.urdf", folder / "franka.xrdf", folder / "franka_rmpflow_config.yaml")
    tree = loaded.tree(position_target=np.ones(3), x_axis_target=np.eye(3)[0], world=SCENE)
    assert all_stated(partial(loaded.acceleration, tree), Q, QD, ways=(many, pulled)) > 0


def test_rollouts():
    def end(goal, q):
        return rollout(tree_24_pairs(goal), q, duration=0.01, dt=0.001, warn=False).q[-1]

    assert all_stated(end, np.ones(3, np.float32), Q, ways=(pulled,)) > 0


def test_physics_in_mjx():
    pytest.importorskip("mujoco.mjx")
    from jaxrmp.scenes import arm_alone
    from jaxrmp.simulation import MjxEngine, Problem, StopCriteria

    place = arm_alone()
    hand = ControlPoints(ROBOT, "panda_hand")
    problem = Problem(tree_24_pairs(np.ones(3)), hand, hand, ROBOT.lower, ROBOT.upper, (MAPS[SelfDistances][0],))
    engine = MjxEngine(place, problem, StopCriteria(), chunk=2, every=1)
    found = products(engine._chunk, engine._problem, jax.tree.map(lambda a: a[0], engine.begin(Q[None])))
    assert found and {p for pair in found for p in pair} <= {Precision.HIGHEST, Precision.HIGH}  # HIGH is MJX's own


@pytest.mark.parametrize("activation", ["relu", "softplus"])
def test_training(activation):
    pytest.importorskip("flax")
    from jaxrmp.learning import initial_cholesky_factor
    from jaxrmp.learning._metric_training import field_loss

    factor = initial_cholesky_factor(jax.random.key(0), 3, (8, 4), activation)
    x = of_shape((6, 3))

    def loss(factor, x):
        return field_loss(jax.vmap(factor)(x), x, x)

    assert all_stated(lambda x: loss(factor, x), x) > 0
    assert (
        all_stated(
            lambda weights: jax.grad(loss)(factor.__class__(weights, 1.0, None, 3, (8, 4), activation), x),
            factor.weights,
            ways=(value,),
        )
        > 0
    )


def test_a_world_without_obstacles():
    all_stated(lambda p: World().signed_distance(p), np.ones(3, np.float32))
