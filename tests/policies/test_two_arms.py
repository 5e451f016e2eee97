"""Two arms on one torso: both hands at once, each to its own target or by its own skill."""

from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, RobotError, ShapeError, acceleration, uncertified_leaves
from jaxrmp.kinematics import ControlPoints, forward_kinematics, load_robot, load_robot_from_string
from jaxrmp.learning import Configuration, Skill, SkillOnRobot, Subtask, initial_cholesky_factor
from jaxrmp.leaves import Damping, JointLimit, Learned, NominalPotential
from jaxrmp.policies import reaching_policy, whole_arm_policy
from jaxrmp.simulation import rollout
from jaxrmp.world import SelfDistances, World, own_self_pairs, own_spheres

ARM = """<body name="{0}_base" pos="0 {1} .4"><geom size=".06"/>
<body name="{0}_upper"><joint name="{0}_1" axis="0 0 1" range="-2 2"/><joint name="{0}_2" axis="0 1 0" range="-2 2"/>
<geom pos=".2 0 0" size=".06"/><body name="{0}_fore" pos=".3 0 0"><joint name="{0}_3" axis="0 1 0" range="-2.5 2.5"/>
<geom pos=".2 0 0" size=".05"/><body name="{0}_hand" pos=".3 0 0"><joint name="{0}_4" axis="0 0 1" range="-2 2"/>
<joint name="{0}_5" axis="0 1 0" range="-2 2"/><joint name="{0}_6" axis="1 0 0" range="-3 3"/>
<geom pos=".1 0 0" size=".05"/></body></body></body></body>"""
TWO = f"""<mujoco model="two"><compiler angle="radian" autolimits="true"/><worldbody>
<body name="torso"><joint name="turn" axis="0 0 1" range="-1 1"/>
<geom pos="0 0 .1" size=".1"/>{ARM.format("left", 0.25)}{ARM.format("right", -0.25)}</body>
</worldbody></mujoco>"""
REST = np.array([0.0, 0.3, 0.6, 0.8, 0.2, 0.3, 0.0, -0.3, 0.6, 0.8, -0.2, 0.3, 0.0])
HANDS = ("left_hand", "right_hand")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("two")
    (folder / "two.xml").write_text(TWO)
    return folder


@pytest.fixture(scope="module")
def robot(folder):
    return load_robot(folder / "two.xml")


@pytest.fixture(scope="module")
def both(robot):
    return reaching_policy(robot, HANDS, REST)


def poses(robot, q, frames=HANDS):
    return np.stack([np.asarray(forward_kinematics(robot, q, frame)) for frame in frames])


def test_both_hands_reach_their_own_targets_and_keep_off_each_other(robot, both):
    """The targets are crossed: each hand's is before the other shoulder."""
    asked = REST + np.array([0.2, -0.6, 0.2, 0.1, -0.2, 0.1, 0.4, 0.5, 0.5, 0.2, 0.3, 0.1, -0.4])
    goals, start = poses(robot, asked), jnp.asarray(REST, jnp.float32)
    tree = both.tree(goals, World())
    assert uncertified_leaves(tree) == ()
    path = jax.jit(lambda tree: rollout(tree, start, duration=6.0, dt=0.002, warn=False))(tree)
    off = poses(robot, path.q[-1]) - goals
    assert np.linalg.norm(off[:, :3, 3], axis=1).max() < 0.01 and np.abs(off[:, :3, :3]).max() < 0.1
    spheres = own_spheres(robot)
    own = SelfDistances(spheres.points(robot), own_self_pairs(robot, spheres), spheres.radii)
    assert jax.jit(jax.vmap(lambda q: own(q).min()))(path.q[::50]).min() > 0


def test_one_hand_named_alone_is_the_same_policy_but_for_the_targets_axis(robot):
    one, listed = reaching_policy(robot, HANDS[0], REST), reaching_policy(robot, HANDS[:1], REST)
    T = poses(robot, REST, HANDS[:1])
    trees = [one.tree(T[0], World()), listed.tree(T, World())]
    assert jax.tree.structure(trees[0]) == jax.tree.structure(trees[1])
    jax.tree.map(np.testing.assert_array_equal, *trees)


def test_targets_move_without_compiling_anew_and_have_gradients(robot):
    both, traces = reaching_policy(robot, HANDS, REST, self_collision=False), []
    q, still = jnp.asarray(REST, jnp.float32), jnp.zeros(13, jnp.float32)

    @jax.jit
    @jax.vmap
    def pull(T):
        traces.append(0)
        return jax.value_and_grad(lambda T: acceleration(both.tree(T, World()), q, still)[7])(T)

    goals = jnp.stack([jnp.asarray(poses(robot, 0.8 * REST), jnp.float32)] * 2).at[0, 1, 0, 3].add(0.1)
    (one, other), slope = pull(goals)
    pull(goals[::-1])
    assert len(traces) == 1 and abs(one - other) > 0.1
    assert np.isfinite(slope).all() and np.abs(slope[:, 1, :3, 3]).max() > 0.1


def test_hands_and_targets_that_do_not_fit_are_told(robot, both):
    with pytest.raises(ShapeError, match=r"shape \(4, 4\), expected \(2, 4, 4\): a pose for each of 2\."):
        both.tree(np.eye(4), World())
    with pytest.raises(ShapeError, match=r"shape \(2, 4, 4\), expected \(4, 4\): a pose"):
        reaching_policy(robot, HANDS[0]).tree(poses(robot, REST), World())
    for wrong in ((), ("left_hand", "left_hand")):
        with pytest.raises(ConfigurationError, match="at least one frame, and each once"):
            reaching_policy(robot, wrong)


TARGETS = np.array([[0.0, 0.0, 0.0], [0.0, 0.06, 0.0]])  # of a tool's origin and of a point beside it, where skills end
MOUNT = "[1.0, 2.0, 3.0, 0.3, 0.2, 0.1]"  # the arms were taught elsewhere


def skill_of(folder, side):
    """A skill that a straight demonstration gives, on one arm of the file, with a tool, and where that was mounted."""
    file = folder / f"{side}.toml"
    tool = f'[tools.tcp]\nframe = "{side}_hand"\npose = [0.1, 0.0, 0.02, 0.0, 0.5, 0.0]\n'
    file.write_text(f'file = "two.xml"\nroot = "{side}_base"\nmount = {MOUNT}\n{tool}')
    arm = load_robot(file)
    points = jnp.linspace(jnp.array([-0.2, 0.1, 0.2]), jnp.zeros(3), 20)
    potential = NominalPotential(points, jnp.linspace(0.2, 0.0, 20), jnp.zeros(3), jnp.array(0.05), jnp.array(30.0))
    factors = jax.vmap(lambda key: initial_cholesky_factor(key, hidden=(8, 4), length_scale=0.1))
    frames = ("tcp", "tcp")
    subtasks = tuple(Subtask(name, "tcp", tuple(at)) for name, at in zip("ab", TARGETS.tolist(), strict=True))
    return Skill(
        Learned(jax.tree.map(lambda a: jnp.stack([a, a]), potential), factors(jax.random.split(jax.random.key(0))),
                jnp.full(2, 0.2), jnp.full(2, 40.0)),
        Damping(jnp.float32(2e-3), jnp.float32(10.0), name="joint_damping"),
        jax.tree.map(jnp.float32, JointLimit(arm.lower, arm.upper)),
        *map(jnp.float32, (TARGETS, TARGETS, np.eye(4), np.eye(3))),
        frames, ("a", "b"), tuple(range(6)), Configuration(side, subtasks, str(file)), arm.fingerprint,
    )  # fmt: skip


@pytest.fixture(scope="module")
def skills(folder):
    return [skill_of(folder, side) for side in ("left", "right")]


def moved(robot, skill):
    """Where the world of the skill's own arm is in the robot's, its torso at zero, [4, 4]."""
    arm, base = skill.load_robot(), f"{skill.configuration.name}_base"
    there, here = (np.asarray(forward_kinematics(r, np.zeros(r.num_joints), base)) for r in (robot, arm))
    return there @ np.linalg.inv(here)


@pytest.mark.parametrize(("side", "first"), [(0, 1), (1, 7)])
def test_a_skill_of_one_arm_does_to_it_on_the_whole_robot_what_it_does_alone(side, first, robot, skills):
    """It is the same form on the arm's joints, with the target moved as the arm is, and pulls at the torso too."""
    skill, rows, T = skills[side], slice(first, first + 6), np.eye(4)
    q, qd, T[:3, 3] = REST, np.linspace(-1, 1, 13) * (np.arange(13) > 0), [0.4, -0.3, 0.3]
    arm, on = skill.load_robot(), skill.on(robot)
    assert isinstance(on, SkillOnRobot) and skill.on(arm) is skill and on.joints == tuple(range(13))[rows]
    with jax.enable_x64(True):
        whole = jax.jit(lambda tree: tree(q, qd))(on.tree(robot, moved(robot, skill) @ T))
        alone = jax.jit(lambda tree: tree(q[rows], qd[rows]))(skill.tree(arm, T))
    np.testing.assert_allclose(whole.M[rows, rows], alone.M, atol=1e-5)
    np.testing.assert_allclose(whole.f[rows], alone.f, atol=1e-4)
    others = np.setdiff1d(np.arange(1, 13), on.joints)
    M = np.asarray(whole.M)
    assert not M[others].any() and M[0, 0] > 0


def test_two_skills_bring_both_hands_to_their_targets_at_once(robot, skills):
    policy, start, asked = whole_arm_policy(skills, robot), jnp.asarray(REST, jnp.float32), 0.6 * REST
    arms = [(skill, asked[rows]) for skill, rows in zip(skills, (slice(1, 7), slice(7, 13)), strict=True)]
    goals = [moved(robot, skill) @ forward_kinematics(skill.load_robot(), q, "tcp") for skill, q in arms]
    tree = policy.tree(jnp.stack(goals), World())
    assert uncertified_leaves(tree) == ()
    end = jax.jit(lambda tree: rollout(tree, start, duration=8.0, dt=0.002, warn=False))(tree).q[-1]
    for skill, T in zip(skills, goals, strict=True):
        on = skill.on(robot)
        points = ControlPoints(robot, on.frames, on.skill.offsets)(end)
        np.testing.assert_allclose(points, TARGETS @ T[:3, :3].T + T[:3, 3], atol=0.01)
    tree, same = policy.tree(goals[0], World()), policy.tree(jnp.stack(goals[:1] * 2), World())  # one for both
    jax.tree.map(np.testing.assert_array_equal, tree, same)


def test_joints_that_no_skill_knows_keep_their_limits_and_are_slowed_down(robot, skills):
    names = [leaf.name for leaf in whole_arm_policy(skills, robot).always.leaves()]
    assert names.count("joint_limit") == 1 and "joint_damping" in names
    one = whole_arm_policy(skills[0], robot)
    assert one.always.leaves()[names.index("joint_limit")].lower.shape == (7,)  # of the torso and the other arm
    with pytest.raises(ShapeError, match=r"expected \(4, 4\): a pose"):
        one.tree(np.stack([np.eye(4)] * 2), World())
    with pytest.raises(ShapeError, match=r"expected \(2, 4, 4\): a pose for each of 2, or \(4, 4\), one for all"):
        whole_arm_policy(skills, robot).tree(np.stack([np.eye(4)] * 3), World())
    with pytest.raises(ConfigurationError, match="skill is empty"):
        whole_arm_policy([], robot)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("right_fore", "other"), "body 'right_fore' is not there"),
        (("right_4", "other"), r"\['right_4'\] are no joints.*body 'right_hand' has other joints"),
        (('right_hand" pos=".3', 'right_hand" pos=".31'), "body 'right_hand' sits elsewhere"),
        (('right_3" axis="0 1 0', 'right_3" axis="0 0 1'), "body 'right_fore' has other joints"),
    ],
)
def test_a_robot_without_a_skills_arm_is_told_which_and_why(change, told, skills):
    other = load_robot_from_string(TWO.replace(*change))
    with pytest.raises(RobotError, match=f"skill 'right' cannot run on 'two'.*right.toml.*{told}"):
        whole_arm_policy(skills, other)


def test_an_arms_joint_that_is_locked_on_the_whole_robot_is_told(folder, skills):
    locked = load_robot(folder / "two.xml", fixed={"left_2": 0.1})
    with pytest.raises(RobotError, match=r"skill 'left'.*\['left_2'\] are no joints.*body 'left_upper'"):
        whole_arm_policy(skills, locked)
    moved = replace(skills[0], configuration=replace(skills[0].configuration, robot="gone.toml"))
    with pytest.raises(RobotError, match="gone.toml"):
        moved.on(locked)
    with pytest.raises(RobotError, match="was learned on robot"):
        skills[0].on(locked, skills[1].load_robot())
