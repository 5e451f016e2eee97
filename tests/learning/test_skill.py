"""Skills as values and as files."""

import json
import zipfile
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrmp
from jaxrmp import ConfigurationError, RobotError, SkillFileError, acceleration
from jaxrmp._rotations import pose, rotation_of_vector
from jaxrmp.kinematics import load_robot_from_string, mounted, panda, record_of, with_tool
from jaxrmp.learning import (
    Configuration,
    Skill,
    Subtask,
    initial_cholesky_factor,
    load_skill,
    save_skill,
)
from jaxrmp.learning._skill import mean_pose, rigid_targets
from jaxrmp.leaves import Damping, JointLimit, Learned, NominalPotential

OFFSETS = np.array([[0.0, 0.0, 0.207], [0.0286, 0.0286, 0.2104], [-0.0286, -0.0286, 0.2104]])
FRAMES = ("panda_link7",) * 3
Q = jnp.array([0.1, -0.6, 0.2, -2.0, 0.1, 1.6, 0.7], jnp.float32)


@pytest.fixture
def skill() -> Skill:
    keys = jax.random.split(jax.random.key(0), 3)
    points = jnp.linspace(jnp.array([0.3, 0.1, 0.2]), jnp.zeros(3), 20)
    potential = NominalPotential(points, jnp.linspace(0.2, 0.0, 20), jnp.zeros(3), jnp.array(0.05), jnp.array(30.0))
    stacked = jax.tree.map(lambda a: jnp.stack([a, a, a]), potential)
    factors = jax.vmap(lambda key: initial_cholesky_factor(key, hidden=(16, 8), length_scale=0.1))(keys)
    return Skill(
        joint_damping=Damping(jnp.float32(2e-3), jnp.float32(10.0), name="joint_damping"),
        joint_limit=jax.tree.map(jnp.float32, JointLimit(panda().lower, panda().upper)),
        limited=tuple(range(7)),
        learned=Learned(stacked, factors, jnp.full(3, 0.2), jnp.full(3, 40.0)),
        offsets=jnp.asarray(OFFSETS, jnp.float32),
        targets=jnp.asarray(OFFSETS - OFFSETS[0], jnp.float32),
        T_world_object=jnp.eye(4).at[:3, 3].set(jnp.array([0.5, 0.1, 0.4])),
        R_object_hand=jnp.eye(3),
        frames=FRAMES,
        subtasks=("gripper", "left", "right"),
        configuration=Configuration("reach", tuple(Subtask(n, "panda_link7") for n in ("gripper", "left", "right"))),
        robot_fingerprint=panda().fingerprint,
        source="test",
    )


def test_a_saved_skill_comes_back_bit_for_bit(skill, tmp_path):
    loaded = load_skill(save_skill(skill, tmp_path / "reach.skill.npz"))
    assert jax.tree.structure(loaded) == jax.tree.structure(skill)
    for a, b in zip(jax.tree.leaves(skill), jax.tree.leaves(loaded), strict=True):
        assert jnp.asarray(a).dtype == b.dtype
        np.testing.assert_array_equal(np.asarray(a), np.asarray(b))
    assert loaded.configuration == skill.configuration
    qdd = [jax.jit(acceleration)(s.tree(panda()), Q, 0 * Q) for s in (skill, loaded)]
    np.testing.assert_array_equal(*qdd)


def test_a_skill_is_refused_on_another_robot(skill):
    arm = load_robot_from_string(
        "<mujoco><worldbody><body name='panda_link7'><joint name='j' axis='0 0 1'/><geom size='.1'/></body></worldbody>"
        "</mujoco>"
    )
    with pytest.raises(RobotError, match="was learned on robot 'panda'.*learn it again"):
        skill.tree(arm)


def test_moving_the_object_moves_the_policy_and_does_not_retrace(skill):
    traces = []

    @jax.jit
    def act(tree, q, qd):
        traces.append(1)
        return acceleration(tree, q, qd)

    robot, moved = panda(), np.array(skill.T_world_object)
    moved[1, 3] += 0.2
    here, there = (act(skill.tree(robot, T), Q, 0 * Q) for T in (skill.T_world_object, moved))
    assert len(traces) == 1
    assert np.abs(here - there).max() > 0.1


def test_gains_change_the_tempo_and_not_the_path(skill):
    fast = skill.with_gains(0.4, 80.0)
    np.testing.assert_array_equal(fast.learned.speed, np.full(3, 0.4, np.float32))
    with pytest.raises(ConfigurationError, match="speed is -1, expected a positive number"):
        skill.with_gains(-1, 80.0)
    x = jnp.full((3, 3), 0.1)
    fields = [jax.vmap(lambda leaf, x: leaf.field(x))(s.learned, x) for s in (skill, fast)]
    np.testing.assert_array_equal(*fields)


def test_the_tree_is_certified_and_names_its_leaves(skill):
    tree = skill.tree(panda())
    assert jaxrmp.uncertified_leaves(tree) == ()
    assert [leaf.name for leaf in tree.leaves()] == ["learned", "joint_damping", "joint_limit"]


@pytest.mark.parametrize(
    "damage",
    ["missing", "truncated", "flipped", "text", "npz", "version", "extra", "lacking", "gelu", "nan", "float64"],
)
def test_files_that_are_no_whole_skill_of_this_version_are_refused(skill, tmp_path, damage):
    path = save_skill(skill, tmp_path / "reach.skill.npz")
    expected = "is no skill file, or is damaged"
    if damage == "missing":
        path.unlink()
        expected = "there is no skill file"
    elif damage == "truncated":
        path.write_bytes(path.read_bytes()[:2000])
    elif damage == "flipped":
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 255
        path.write_bytes(content)
    elif damage == "text":
        path.write_text("not a skill")
    elif damage == "npz":
        np.savez(path, a=np.zeros(3))
        expected = "no skill: it has no readable header"
    else:
        with np.load(path) as archive:
            arrays = dict(archive)
        header = json.loads(arrays.pop("header.json").tobytes())
        if damage == "version":
            header["version"] = 99
            expected = (
                "version 99; this jaxrmp reads versions 1 to 8. It was written by jaxrmp .* a newer one, or learn"
            )
        elif damage == "extra":
            header["mystery"] = 1
            expected = "missing or unknown: .*mystery"
        elif damage == "lacking":
            del arrays["targets"]
            expected = "arrays .* missing or unknown: .*targets"
        elif damage == "gelu":
            header["network"]["activation"] = "gelu"
            expected = "unknown activation 'gelu'"
        elif damage == "nan":
            arrays["targets"] = np.full_like(arrays["targets"], np.nan)
            expected = "array targets holds non-finite numbers"
        else:
            arrays["targets"] = arrays["targets"].astype(float)
            header["arrays"]["targets"][0] = "float64"
            expected = "array targets is float64; load it under jax.enable_x64"
        arrays["header.json"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
        with path.open("wb") as file:
            np.savez(file, **arrays)
    with pytest.raises(SkillFileError, match=expected):
        load_skill(path)


def rewritten(path, change):
    """The skill file at `path` with its header and arrays as `change` leaves them."""
    with np.load(path) as archive:
        arrays = dict(archive)
    header = json.loads(arrays.pop("header.json").tobytes())
    change(header, arrays)
    header["arrays"] = {name: [str(a.dtype), list(a.shape)] for name, a in arrays.items()}
    np.savez(path, **{"header.json": np.frombuffer(json.dumps(header).encode(), np.uint8)}, **arrays)
    return path


def as_version_4(header, arrays):
    """As files were before there were flows."""
    header["version"] = 4
    del header["robot"], header["flow"], header["configuration"]["method"], header["configuration"]["flow"]


def as_version_3(header, arrays):
    as_version_4(header, arrays)
    header["version"] = 3
    policy = header["configuration"]["policy"]
    damping, limit = policy.pop("joint_damping"), policy.pop("joint_limit")
    policy |= {"joint_damping_weight": damping["weight"], "joint_damping_rate": damping["damping_rate"]}
    gains = {"weight": 0.01, "sigma": 0.1, "barrier": 0.01, "reach": 0.1, "frequency": 50.0} | limit
    policy |= {f"joint_limit_{name}": value for name, value in gains.items()}


def as_version_2(header, arrays, early=False):
    """As the last, or the first, that wrote version 2 did."""
    as_version_3(header, arrays)
    header["version"] = 2
    del arrays["R_object_hand"]
    if early:
        del header["network"]["supported"]
        del header["configuration"]["metric"]["reach"], header["configuration"]["metric"]["convergence"]


def as_version_1(header, arrays):
    as_version_2(header, arrays, early=True)
    header["version"] = 1
    del arrays["joint_limit/frequency"], header["configuration"]["policy"]["joint_limit_frequency"]


@pytest.mark.parametrize("earlier", [as_version_1, partial(as_version_2, early=True), as_version_2, as_version_3])
def test_files_of_earlier_versions_are_brought_up_to_date(skill, tmp_path, earlier):
    R = rotation_of_vector(np.array([0.5, -1.0, 2.0]))
    skill = replace(skill, targets=jnp.asarray(OFFSETS @ R.T + 0.1, jnp.float32))
    loaded = load_skill(rewritten(save_skill(skill, tmp_path / "old.skill.npz"), earlier))
    np.testing.assert_allclose(loaded.R_object_hand, skill.R_object_hand if earlier is as_version_3 else R, atol=1e-5)
    assert loaded.R_object_hand.dtype == jnp.float32
    metric, policy = loaded.configuration.metric, loaded.configuration.policy
    late = earlier in (as_version_2, as_version_3)
    assert (metric.reach, metric.convergence) == ((0.05, 0.1) if late else (0.0, 1e6))
    assert policy.joint_damping == skill.configuration.policy.joint_damping
    assert policy.joint_limit["barrier"] == 0.01 and ("frequency" in policy.joint_limit) == (
        earlier is not as_version_1
    )
    same = replace(loaded, R_object_hand=skill.R_object_hand, configuration=skill.configuration)
    assert jax.tree.structure(same) == jax.tree.structure(skill)
    for a, b in zip(jax.tree.leaves(skill), jax.tree.leaves(same), strict=True):
        np.testing.assert_array_equal(a, b)
    again = load_skill(save_skill(loaded, tmp_path / "new.skill.npz"))
    assert jax.tree.structure(again) == jax.tree.structure(loaded)


def test_a_skill_file_holds_the_robot(skill, tmp_path):
    robot = with_tool(mounted(panda(), pose([0.1, 0.2, 0.3], np.eye(3))), "tip", "panda_hand", np.eye(4))
    said = {"ignore": (("panda_hand", "panda_link5"),), "cover_error": 0.01}
    robot = replace(robot, model=replace(robot.model, **said))
    robot = replace(robot, upper=np.where(np.arange(7) == 6, np.inf, robot.upper))
    own = replace(skill, robot_fingerprint=robot.fingerprint, robot_record=record_of(robot))
    loaded = load_skill(save_skill(own, tmp_path / "own.skill.npz")).robot
    assert loaded.model == robot.model and loaded.fingerprint == robot.fingerprint != panda().fingerprint
    for name in ("lower", "upper", "velocity_limit"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(robot, name))
    assert loaded.source == robot.source
    assert {name: getattr(loaded.model, name) for name in said} == said
    with pytest.raises(RobotError, match=f"robot_record has kinematic fingerprint {robot.fingerprint}, expected"):
        replace(skill, robot_record=record_of(robot))


def test_its_own_robot_stands_in_where_the_file_that_it_was_read_from_is_gone(skill):
    gone = replace(skill, configuration=replace(skill.configuration, robot="gone/arm.urdf"))
    with pytest.raises(RobotError, match="the robot that the skill was learned on: .*gone/arm.urdf.*--robot FILE"):
        gone.load_robot()
    robot = replace(gone, robot_record=record_of(panda())).load_robot()
    assert robot.model == panda().model


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda robot: robot.pop("bodies"), "a robot's record has .*expected"),
        (lambda robot: robot["joints"][0].update(body=99), "the parts of 'panda' do not belong together"),
        (lambda robot: robot["joints"][0].update(axis=[0.0, 1.0]), "axis of 'panda_joint1' is .*expected 3 numbers"),
        (lambda robot: robot["lower"].pop(), "do not belong together"),
        (lambda robot: robot["frames"][0].update(mystery=1), "cannot be read: .*mystery"),
        (lambda robot: robot["bodies"][3].update(position=[0.0, 0.0, 0.1]), "kinematic fingerprint"),
    ],
)
def test_a_robot_that_is_no_whole_one_is_refused(skill, tmp_path, change, expected):
    path = save_skill(replace(skill, robot_record=record_of(panda())), tmp_path / "odd.skill.npz")
    with pytest.raises(SkillFileError, match=expected):
        load_skill(rewritten(path, lambda header, arrays: change(header["robot"])))


def test_an_earlier_skill_that_does_not_say_how_the_hand_is_turned_is_refused(skill, tmp_path):
    line = np.linspace(0, 1, 3)[:, None] * np.array([[0.0, 0.0, 0.1]])
    path = save_skill(replace(skill, offsets=jnp.asarray(line, jnp.float32)), tmp_path / "old.skill.npz")
    with pytest.raises(SkillFileError, match=r"does not say how the hand is turned .* learn the skill again"):
        load_skill(rewritten(path, as_version_2))


@pytest.mark.parametrize("version", [0, 9, "8", None, True])
def test_versions_that_are_none_are_refused(skill, tmp_path, version):
    path = save_skill(skill, tmp_path / "odd.skill.npz")
    with pytest.raises(SkillFileError, match=f"version {version!r}; this jaxrmp reads versions 1 to 8"):
        load_skill(rewritten(path, lambda header, arrays: header.update(version=version)))


def test_a_skill_file_holds_no_pickle(skill, tmp_path):
    path = save_skill(skill, tmp_path / "reach.skill.npz")
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            assert b"|O" not in archive.read(name)[:200]


def test_a_skill_that_cannot_be_saved_leaves_the_old_file(skill, tmp_path):
    path = save_skill(skill, tmp_path / "reach.skill.npz")
    before = path.read_bytes()
    with pytest.raises(SkillFileError, match="can be saved"):
        save_skill(replace(skill, learned=replace(skill.learned, cholesky_of=lambda x: jnp.eye(3))), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["reach.skill.npz"]


def test_targets_become_a_rigid_placement_of_the_control_points():
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    placed = OFFSETS @ turn.T + [0.4, 0.2, 0.3]
    np.testing.assert_allclose(rigid_targets(OFFSETS, FRAMES, np.stack([placed, placed])), placed, atol=1e-12)
    noise = np.random.default_rng(0).normal(size=(2, 3, 3)) * 0.01
    targets = rigid_targets(OFFSETS, FRAMES, placed + noise)
    distances = [np.linalg.norm(x[:, None] - x[None], axis=-1) for x in (targets, OFFSETS)]
    np.testing.assert_allclose(*distances, atol=1e-12)
    with pytest.raises(jaxrmp.ShapeError, match="do not fit together"):
        rigid_targets(OFFSETS, FRAMES, placed)


def test_the_mean_pose_of_opposite_turns_is_no_turn():
    def about_z(angle):
        T = np.eye(4)
        T[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        T[0, 3] = angle
        return T

    np.testing.assert_allclose(mean_pose(np.stack([about_z(0.3), about_z(-0.3)])), np.eye(4), atol=1e-12)


def test_gains_are_parameters_of_the_tree(skill):
    """No gain is hidden in the structure: changing any of them does not retrace, and gradients reach it."""
    traces = []

    @jax.jit
    def speed_of(skill, q):
        traces.append(1)
        return jnp.sum(acceleration(skill.tree(panda()), q, jnp.full(7, 0.1, jnp.float32)) ** 2)

    for factor in (1.0, 2.0):
        changed = replace(
            skill.with_gains(0.2 * factor, 40.0), joint_damping=replace(skill.joint_damping, weight=jnp.float32(factor))
        )
        slopes = jax.grad(speed_of)(changed, Q)
        speed_of(changed, Q)
    assert len(traces) == 1
    for slope in (slopes.learned.speed, slopes.joint_damping.damping_rate, slopes.joint_limit.weight):
        assert np.isfinite(slope).all()
        assert np.abs(slope).max() > 0


def test_a_skill_runs_where_the_robot_is_an_argument(skill):
    qdd = jax.jit(lambda robot, q: acceleration(skill.tree(robot), q, 0 * q))(panda(), Q)
    np.testing.assert_allclose(qdd, jax.jit(acceleration)(skill.tree(panda()), Q, 0 * Q), rtol=1e-3, atol=1e-3)


def test_the_learned_policy_does_not_deadlock_in_large_batches(skill):
    """Batched LAPACK in jaxlib can hang a program of several factorisations; ours are written out."""
    act = jax.jit(jax.vmap(acceleration, in_axes=(None, 0, 0)))
    tree, q = skill.tree(panda()), Q + 0.1 * jax.random.normal(jax.random.key(0), (1024, 7))
    assert "lapack" not in act.lower(tree, q, 0 * q).as_text().lower()
    for _ in range(100):
        qdd = act(tree, q, 0 * q).block_until_ready()
    assert np.isfinite(qdd).all()
