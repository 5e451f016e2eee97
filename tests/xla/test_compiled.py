"""What `compiled` returns does what the function does, whatever its arguments travel as, and refuses all others."""

from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrmp
from jaxrmp import Batched, ShapeError, acceleration, pullback
from jaxrmp.kinematics import ControlPoints, panda
from jaxrmp.leaves import Attractor, CollisionAvoidance, Damping, JointLimit
from jaxrmp.world import ObstacleDistances, Spheres, World

VECTOR = np.zeros(3, np.float32)


def test_arm_among_obstacles_that_move(x64):
    robot = panda()

    def policy(moving, q, qd):
        goal, obstacles = moving
        points = ControlPoints(robot, ("panda_link5", "panda_hand"))
        distances = ObstacleDistances(points, World(spheres=obstacles), 0.08)
        tree = pullback(ControlPoints(robot, ("panda_hand",)), Batched(Attractor(goal), shared=True))
        tree += pullback(distances, CollisionAvoidance(reach=0.3, barrier=0.01))
        return acceleration(tree + JointLimit(robot.lower, robot.upper) + Damping(), q, qd)

    rng = np.random.default_rng(0)
    obstacles = Spheres.of([((0.5, 0.1, 0.5), 0.1), ((0.3, 0.3, 0.3), 0.1)], capacity=3)
    moving = (np.array([0.4, 0.3, 0.5]), obstacles)
    middle = (robot.lower + robot.upper) / 2
    call = jaxrmp.compiled(policy, moving, middle, middle)
    assert call.one_kernel == (jax.default_backend() == "cpu")
    expected = jax.jit(policy)
    for _ in range(20):
        obstacles = Spheres(rng.uniform(0.2, 0.6, (3, 3)), np.full(3, 0.1), rng.random(3) > 0.5)
        moving = (rng.uniform(0.2, 0.6, 3), obstacles)
        state = middle + 0.3 * rng.normal(size=7), 0.3 * rng.normal(size=7)
        found = call(moving, *state)
        assert isinstance(found, np.ndarray)
        wanted = np.asarray(expected(moving, *state))
        np.testing.assert_allclose(found, wanted, rtol=1e-9)


def test_arguments_of_all_kinds_arrive():
    def function(flag, count, number, single, tree):
        return {"flag": flag, "count": count + 1, "scaled": number * single, **tree}

    on_device = jnp.arange(2.0)
    call = jaxrmp.compiled(function, np.array([True, False]), 3, 0.5, VECTOR, {"a": on_device, "b": VECTOR})
    found = call(np.array([False, True]), 4, 2.0, np.arange(3), {"a": on_device + 1, "b": np.ones(3)})
    assert found["flag"].tolist() == [False, True] and found["flag"].dtype == bool
    assert found["count"] == 5 and found["count"].dtype.kind == "i"
    assert found["scaled"].tolist() == [0.0, 2.0, 4.0]
    assert found["a"].tolist() == [1.0, 2.0] and found["b"].tolist() == [1.0, 1.0, 1.0]


def test_flags_alone_and_no_arguments_at_all():
    assert jaxrmp.compiled(lambda flag: ~flag, np.array([True]))(np.array([False])).tolist() == [True]
    assert jaxrmp.compiled(lambda: jnp.ones(2))().tolist() == [1.0, 1.0]


def test_shapes_alone_as_examples():
    call = jaxrmp.compiled(lambda x: 2 * x, jax.ShapeDtypeStruct((3,), np.float32))
    assert call(np.arange(3.0)).tolist() == [0.0, 2.0, 4.0]


def test_a_result_stays_when_the_next_call_comes():
    call = jaxrmp.compiled(lambda x: (x, x + 1), VECTOR)
    first, second = call(VECTOR), call(np.full(3, 7.0, np.float32))
    assert first[0].tolist() == [0.0] * 3 and first[1].tolist() == [1.0] * 3
    assert second[0].tolist() == [7.0] * 3


@pytest.mark.parametrize(
    "arguments",
    [(VECTOR[:2], 1), (VECTOR[None], 1), (1.0, 1), (VECTOR, 1.5), (VECTOR * 1j, 1), (VECTOR,), ([VECTOR], 1)],
)
def test_other_arguments_are_refused(arguments):
    call = jaxrmp.compiled(lambda x, count: x * count, VECTOR, 1)
    with pytest.raises(ShapeError, match="compiled for"):
        call(*arguments)
    assert call(VECTOR + 1, 2).tolist() == [2.0] * 3


def test_examples_that_are_no_arrays_are_refused():
    with pytest.raises(TypeError, match="expected arrays"):
        jaxrmp.compiled(lambda x: x, "three")


def test_what_does_not_go_into_one_kernel_is_compiled_all_the_same():
    A = np.array([[2.0, 1.0], [1.0, 3.0]], np.float32)
    call = jaxrmp.compiled(jnp.linalg.pinv, A)
    assert not call.one_kernel
    np.testing.assert_allclose(call(A), np.linalg.inv(A), rtol=1e-5)


def test_threads_take_turns():
    call = jaxrmp.compiled(jnp.cumsum, np.zeros(50, np.float32))

    def differences(k):
        return [np.ptp(np.diff(call(np.full(50, k + i, np.float32)))) for i in range(200)]

    with ThreadPoolExecutor(4) as threads:
        assert max(max(found) for found in threads.map(differences, range(4))) < 1e-2
