"""The control point map: Jacobian and Jdot qd against MuJoCo, autodiff and pytorch-kinematics; jit and vmap."""

import os
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import Batched, NaturalForm, pullback, transport
from jaxrmp._errors import ShapeError, UnknownNameError
from jaxrmp._task_map import TaskMap, pushforward_by_autodiff
from jaxrmp.kinematics import ControlPoints, Position, forward_kinematics, load_robot, load_robot_from_string, panda
from jaxrmp.leaves import Attractor

FRAMES = {
    "panda": ("panda_link7", "panda_hand", "panda_link4", "panda_link7", "panda_rightfinger", "panda_link0"),
    "branching": ("left_tool", "right_finger", "column", "right_hook", "left_tool", "site:left_lower", "world"),
}


COUNT = 200


def control_points(robot):
    frames = FRAMES[robot.name]
    return ControlPoints(robot, frames, np.random.default_rng(1).uniform(-0.3, 0.3, (len(frames), 3)))


@pytest.fixture(scope="module")
def case(oracle, random_configurations):
    """Control points of a robot, random states, a compiled batched pushforward in float64 and what it gives there."""
    points = control_points(oracle.robot)
    Q = random_configurations(oracle.robot, COUNT)
    QD = np.random.default_rng(2).normal(size=Q.shape)
    with jax.enable_x64(True):
        push = jax.jit(jax.vmap(points.pushforward))
        return oracle, points, Q, QD, push, push(Q, QD)


def test_state_agrees_with_mujoco(case):
    oracle, points, Q, QD, _, carried = case
    for q, qd, y, yd, J, c in zip(Q, QD, *map(np.asarray, carried), strict=True):
        oracle.set(q, qd)
        for k, (frame, offset) in enumerate(zip(points.frames, points.offsets, strict=True)):
            T = oracle.pose(frame)
            J_mujoco, Jdot_mujoco = oracle.jacobians(frame, y[k])
            np.testing.assert_allclose(y[k], T[:3, :3] @ offset + T[:3, 3], rtol=0, atol=1e-12)
            np.testing.assert_allclose(J[k], J_mujoco, rtol=0, atol=1e-12)
            np.testing.assert_allclose(yd[k], J_mujoco @ qd, rtol=0, atol=1e-11)
            np.testing.assert_allclose(c[k], Jdot_mujoco @ qd, rtol=0, atol=1e-10)


def test_analytic_pass_agrees_with_autodiff(case):
    _, points, Q, QD, _, carried = case
    with jax.enable_x64(True):
        generic = jax.jit(jax.vmap(lambda q, qd: pushforward_by_autodiff(points, q, qd)))(Q, QD)
        np.testing.assert_allclose(jax.jit(points)(Q[0]), carried.y[0], atol=1e-14)
    for name, ours, theirs in zip(carried._fields, carried, generic, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-11, err_msg=name)


def test_forms_are_pulled_back_as_through_the_jacobian(case):
    """One at a time and in a batch, with metrics that need not be symmetric; joints that follow others included."""
    _, points, Q, QD, _, carried = case
    Q, QD, J, c = Q[:20], QD[:20], np.asarray(carried.J)[:20], np.asarray(carried.c)[:20]
    rng = np.random.default_rng(3)
    f, M = rng.normal(size=c.shape), rng.normal(size=(*c.shape, 3))

    def pulled(q, qd, f, M):
        y, yd, pull = transport(points, q, qd)
        form = pull(NaturalForm(f, M))
        return y, yd, form.f, form.M

    with jax.enable_x64(True):
        batch, alone = jax.jit(jax.vmap(pulled))(Q, QD, f, M), jax.jit(pulled)(Q[0], QD[0], f[0], M[0])
    expected_f = np.einsum("tkij,tki->tj", J, f - np.einsum("tkij,tkj->tki", M, c))
    expected = (carried.y[:20], carried.yd[:20], expected_f, np.einsum("tkia,tkij,tkjb->tab", J, M, J))
    for ours, one, theirs in zip(batch, alone, expected, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-10 * np.abs(theirs).max())
        np.testing.assert_allclose(one, theirs[0], rtol=0, atol=1e-10 * np.abs(theirs).max())


def test_forms_at_points_that_no_joint_moves_vanish(branching):
    @jax.jit
    def pulled(q, qd):
        _, yd, pull = transport(ControlPoints(branching, ("world",)), q, qd)
        return yd, pull(NaturalForm(jnp.ones((1, 3)), jnp.ones((1, 3, 3))))

    yd, form = pulled(*np.ones((2, branching.num_joints)))
    assert form.f.shape == (branching.num_joints,) and not form.f.any() and not form.M.any() and not yd.any()


def test_curvature_term_agrees_with_finite_differences(case):
    _, _, Q, QD, push, carried = case
    with jax.enable_x64(True):
        Jdot = (push(Q + 1e-6 * QD, QD).J - push(Q - 1e-6 * QD, QD).J) / 2e-6
    np.testing.assert_allclose(carried.c, np.einsum("tkij,tj->tki", Jdot, QD), atol=1e-7)


def test_single_precision_stays_single_and_close(case):
    _, points, Q, QD, push, _ = case
    Q, QD = Q.astype("float32"), QD.astype("float32")
    single = jax.jit(jax.vmap(points.pushforward))(Q, QD)
    with jax.enable_x64(True):
        double = push(Q.astype(float), QD.astype(float))
    assert {x.dtype.name for x in single} == {"float32"}
    for name, ours, truth, atol in zip(single._fields, single, double, (1e-6, 1e-5, 2e-6, 1e-4), strict=True):
        np.testing.assert_allclose(ours, truth, rtol=0, atol=atol, err_msg=name)


def test_agrees_with_pytorch_kinematics(random_configurations):
    torch = pytest.importorskip("torch", reason="pytorch-kinematics, the oracle, needs torch")
    pk = pytest.importorskip("pytorch_kinematics", reason="pytorch-kinematics is the oracle")
    path, frame = Path(__file__).parent / "models" / "arm.urdf", "tool"
    if data := os.environ.get("JAXRMP_DATA"):
        lula = Path(data) / "lula" / "franka.urdf"
        path, frame = (lula, "panda_rightfingertip") if lula.is_file() else (path, frame)
    serial = pk.SerialChain(pk.build_chain_from_urdf(path.read_bytes()), frame).to(dtype=torch.float64)
    robot = load_robot(path)
    Q = random_configurations(robot, 50)
    order = [robot.joint_index(name) for name in serial.get_joint_parameter_names()]
    offset = np.array([0.02, -0.03, 0.05])
    theirs = serial.forward_kinematics(torch.tensor(Q[:, order])).get_matrix().numpy()
    J_theirs = serial.jacobian(torch.tensor(Q[:, order]), locations=torch.tensor(offset).expand(50, 3)).numpy()
    with jax.enable_x64(True):
        poses = jax.jit(jax.vmap(lambda q: forward_kinematics(robot, q, frame)))(Q)
        carried = jax.jit(jax.vmap(ControlPoints(robot, frame, offset[None]).pushforward))(Q, np.zeros_like(Q))
    # It reads angles in single precision, so no closer than this.
    np.testing.assert_allclose(poses, theirs, rtol=0, atol=1e-6)
    np.testing.assert_allclose(carried.J[:, 0][:, :, order], J_theirs[:, :3], rtol=0, atol=1e-6)
    others = [i for i in range(robot.num_joints) if i not in order]
    assert not np.any(carried.J[:, 0][:, :, others])


def test_moving_an_offset_or_a_limit_does_not_retrace():
    traces = []

    @jax.jit
    def height(points, q):
        traces.append(None)
        return points(q)[:, 2].sum() + 0 * points.robot.upper.sum()

    q = jnp.zeros(7)
    for offset in (0.1, 0.2):
        points = ControlPoints(panda(), ("panda_hand",), np.array([[0, 0, offset]]))
        height(points, q)
        lower = jax.tree.map(lambda x: 0.9 * x, points)
        height(lower, q)
    assert len(traces) == 1


def test_offsets_are_parameters():
    with jax.enable_x64(True):
        q = jnp.asarray([0.1, -0.5, 0.3, -2.0, 0.2, 1.5, 0.4])
        offsets = np.random.default_rng(0).normal(size=(5, 2, 3))

        def y(offsets):
            return ControlPoints(panda(), ("panda_hand", "panda_link4"), offsets)(q)

        batch = jax.jit(jax.vmap(y))(offsets)
        one = jax.jit(y)
        np.testing.assert_allclose(batch, [one(o) for o in offsets], atol=1e-14)
        points = ControlPoints(panda(), ("panda_hand", "panda_link4"), offsets[0])
        gradient = jax.jit(jax.grad(lambda points: points(q)[0, 2]))(points)
        R = forward_kinematics(panda(), q, "panda_hand")[:3, :3]
        np.testing.assert_allclose(gradient.offsets, [R[2], np.zeros(3)], atol=1e-14)


def test_gradient_through_the_pushforward(branching, random_configurations):
    points = ControlPoints(branching, "right_hook", np.full((1, 3), 0.1))
    with jax.enable_x64(True):
        q, v = jnp.asarray(random_configurations(branching, 2))

        def energy(q):
            return sum(jnp.sum(jnp.sin(x)) for x in points.pushforward(q, v))

        value_and_slope = jax.jit(jax.vmap(jax.value_and_grad(energy)))
        (_, up, down), slopes = value_and_slope(jnp.stack([q, q + 1e-6 * v, q - 1e-6 * v]))
        np.testing.assert_allclose(slopes[0] @ v, (up - down) / 2e-6, rtol=1e-6)


PLANAR = """<mujoco><worldbody><body name="upper"><joint name="a" axis="0 0 1"/><geom size="0.1"/>
  <body name="hand" pos="0.5 0 0"><joint name="b" axis="0 0 1"/><geom size="0.1"/></body></body></worldbody></mujoco>"""


def test_a_planar_arm_whose_points_never_leave_their_plane():
    robot = load_robot_from_string(PLANAR)
    points = ControlPoints(robot, ("upper", "hand"), np.array([[0.2, 0.0, 0.3], [0.4, 0.1, 0.3]]))
    with jax.enable_x64(True):
        q, qd = jnp.array([0.3, -0.8]), jnp.array([1.0, 0.5])
        form = NaturalForm(jnp.arange(6.0).reshape(2, 3), jnp.stack([jnp.eye(3), jnp.diag(jnp.arange(1.0, 4.0))]))
        at, pulled = jax.jit(
            lambda q, qd: (pushforward_by_autodiff(points, q, qd), transport(points, q, qd).pull(form))
        )(q, qd)
        f = jnp.einsum("kin,ki->n", at.J, form.f - jnp.einsum("kij,kj->ki", form.M, at.c))
        np.testing.assert_allclose(pulled.f, f, atol=1e-12)
        np.testing.assert_allclose(pulled.M, jnp.einsum("kin,kij,kjm->nm", at.J, form.M, at.J), atol=1e-12)


def test_one_name_stands_for_all_offsets_and_origins_are_the_default():
    robot = panda()
    assert ControlPoints(robot, "panda_hand", np.zeros((3, 3))).frames == ("panda_hand",) * 3
    origins = ControlPoints(robot, ["panda_hand", "panda_link4"])
    assert isinstance(origins, TaskMap)
    q = jnp.full(7, 0.3)
    np.testing.assert_allclose(origins(q)[1], forward_kinematics(robot, q, "panda_link4")[:3, 3], atol=1e-6)


def test_mistakes_are_named():
    robot = panda()
    with pytest.raises(UnknownNameError, match="unknown frame 'hand'"):
        ControlPoints(robot, ("hand",), np.zeros((1, 3)))
    with pytest.raises(ShapeError, match=r"offsets has shape \(3, 3\), expected \(2, 3\)"):
        ControlPoints(robot, ("panda_hand", "panda_link4"), np.zeros((3, 3)))
    with pytest.raises(ShapeError, match=r"offsets has shape \(3,\)"):
        ControlPoints(robot, "panda_hand", np.zeros(3))
    with pytest.raises(ShapeError, match=r"xd has shape \(6,\), expected \(7,\)"):
        ControlPoints(robot, "panda_hand").pushforward(jnp.zeros(7), jnp.zeros(6))


def test_a_position_is_one_control_point_as_a_vector():
    robot, offset = panda(), np.array([0.1, -0.2, 0.05])
    one, points = Position(robot, "panda_hand", offset), ControlPoints(robot, "panda_hand", offset[None])
    leaf = Attractor(jnp.array([0.4, 0.2, 0.5]))
    q, qd = jnp.array([0.1, -0.8, 0.2, -2.4, 0.0, 1.6, 0.8]), jnp.full(7, 0.3)

    @jax.jit
    def look(q, qd):
        policies = (pullback(one, leaf), pullback(points, Batched(leaf, shared=True)))
        measured = [policy.measure(q, qd) for policy in policies]
        return one(q), one.pushforward(q, qd), points.pushforward(q, qd), measured

    position, carried, expected, (ours, theirs) = look(q, qd)
    np.testing.assert_allclose(position, expected.y[0], rtol=1e-6)
    for a, b in zip(carried, expected, strict=True):
        np.testing.assert_allclose(a, b[0], rtol=1e-6)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-5), ours, theirs)
    assert jax.eval_shape(Position(robot, "panda_hand"), q).shape == (3,)
    with pytest.raises(UnknownNameError, match="hnd"):
        Position(robot, "hnd")
    with pytest.raises(ShapeError, match=r"shape \(2, 3\), expected \(3,\)"):
        Position(robot, "panda_hand", np.zeros((2, 3)))
