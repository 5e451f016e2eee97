"""A scene of one's own, with another robot and another object, as the guide writes it: in one file."""

import json
import re
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from jaxrmp import ConfigurationError, RobotError, UnknownNameError, scenes
from jaxrmp.cli import main
from jaxrmp.kinematics import ControlPoints, forward_kinematics, load_robot
from jaxrmp.learning import (
    Configuration,
    Demonstration,
    DemonstrationSet,
    Skill,
    Subtask,
    initial_cholesky_factor,
    save_demonstrations,
    save_skill,
    support_of_samples,
)
from jaxrmp.leaves import Damping, JointLimit, Learned, NominalPotential

GUIDE = (Path(__file__).parents[2] / "docs" / "guides" / "new_scene.md").read_text(encoding="utf-8")
START, END = np.array([-1.0, 1.5, 0.3]), np.array([-0.526, 1.605, 0.121])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What a user has: the scene's file, the arm's, demonstrations, and a skill that leads to where they end."""
    out = tmp_path_factory.mktemp("lever")
    code = re.findall(r"^```python\n(.*?)^```$", GUIDE, re.MULTILINE | re.DOTALL)[0]
    (out / "lever.py").write_text(code)
    (out / "arm.xml").write_text(re.findall(r'ARM = """\n(.*?)"""', code, re.DOTALL)[0])
    robot = load_robot(out / "arm.xml")
    share = np.linspace(0, 1, 60)[:, None]
    paths = [START + d + share * (END - START - d) for d in (-0.05, 0.0, 0.05)]
    time, T = np.linspace(0, 3, 60), np.eye(4)
    T[:3, 3] = [0.45, 0.1, 0.3]
    save_demonstrations(
        DemonstrationSet(
            tuple(Demonstration(time, q, {"lever": T}) for q in paths), robot.joint_names, robot="planar", source="test"
        ),
        out / "demos",
    )
    hand = np.asarray(forward_kinematics(robot, jnp.asarray(END, jnp.float32), "tip"))
    way = np.stack([np.asarray(forward_kinematics(robot, q, "tip"))[:3, 3] for q in paths[1][::4]]) - hand[:3, 3]
    potential = NominalPotential(
        jnp.asarray(way, jnp.float32),
        jnp.linspace(0.5, 0.0, len(way)),
        jnp.zeros(3),
        jnp.float32(0.08),
        jnp.float32(30.0),
    )
    potential = replace(potential, end_slope=jax.grad(potential)(jnp.zeros(3)))
    factor = initial_cholesky_factor(jax.random.key(0), hidden=(8, 8), support=support_of_samples(way, 0.1, 8))
    stacked = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32)[None], (potential, factor))
    skill = Skill(
        learned=Learned(*stacked, jnp.full(1, 0.3), jnp.full(1, 20.0)),
        joint_damping=Damping(jnp.float32(0.02), jnp.float32(5.0), name="joint_damping"),
        joint_limit=jax.tree.map(jnp.float32, JointLimit(robot.lower, robot.upper)),
        limited=(0, 1, 2),
        offsets=jnp.zeros((1, 3)),
        targets=jnp.asarray((hand[:3, 3] - T[:3, 3])[None], jnp.float32),
        T_world_object=jnp.asarray(T, jnp.float32),
        R_object_hand=jnp.asarray(hand[:3, :3]),
        frames=("tip",),
        subtasks=("tip",),
        configuration=Configuration("push_lever", (Subtask("tip", "tip"),), str(out / "arm.xml"), object="lever"),
        robot_fingerprint=robot.fingerprint,
        source=str(out / "demos"),
    )
    save_skill(skill, out / "push.skill.npz")
    return out


def test_a_skill_runs_in_it_from_the_command_line(folder, capsys):
    command = ["run", str(folder / "push.skill.npz"), "--scene", str(folder / "lever.py"), "--trials", "4"]
    assert main([*command, "--limit", "8", "--tracker", "off", "--json", str(folder / "run.json")]) == 0, (
        capsys.readouterr().err
    )
    report = json.loads((folder / "run.json").read_text())
    assert report["scene"] == "lever" and report["successes"] == 4
    assert {t["reason"] for t in report["per_trial"]} == {"turned"}
    assert {t["end"] for t in report["per_trial"]} == {"converged"}
    page = (folder / "run.html").read_text(encoding="utf-8")
    assert "lever" in page and page.count("data:image/png;base64,") == 2


@pytest.mark.parametrize("place", ["lever", "alone"])
def test_it_is_evaluated_in_physics(folder, place, capsys):
    command = ["evaluate", str(folder / "push.skill.npz"), "--physics", "mujoco", "--starts", "2", "--around", "0.05"]
    command += ["--scene", f"{folder / 'lever.py'}:scene"] if place == "lever" else []
    command += ["--duration", "8", "--tolerance", "0.03", "--batch", "2", "--json", str(folder / "evaluate.json")]
    assert main(command) == 0, capsys.readouterr().err
    found = json.loads((folder / "evaluate.json").read_text())
    assert found["converged"] == 1.0 and found["non_finite"] == 0
    assert found["starts_that_touched"] == (2 if place == "lever" else 0)


def test_another_robots_skill_is_refused(folder, capsys):
    assert main(["run", str(folder / "push.skill.npz"), "--scene", "drawer"]) == 1
    assert "needs object 'lever', which scene 'drawer' does not have" in capsys.readouterr().err
    assert main(["evaluate", str(folder / "push.skill.npz"), "--robot", "panda", "--starts", "1"]) == 1
    assert "was learned on robot" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("code", "named", "error", "message"),
    [
        ("", "", UnknownNameError, "unknown function of .*Write one, or name it: FILE.py:function"),
        ("def scen(T):\n    return 1", "", UnknownNameError, "Did you mean 'scen'"),
        ("def make(T):\n    return 1", ":make", ConfigurationError, "gave a int, expected a jaxrmp.scenes.Scene"),
        ("1 / 0", "", ConfigurationError, "cannot be run: ZeroDivisionError: division by zero"),
    ],
)
def test_a_file_that_is_no_scene_is_told_of(tmp_path, code, named, error, message):
    (tmp_path / "mine.py").write_text(code)
    with pytest.raises(error, match=message):
        scenes.scene(f"{tmp_path / 'mine.py'}{named}")


def test_a_model_that_will_not_do_is_told_of(folder):
    arm, text = folder / "arm.xml", (folder / "arm.xml").read_text()
    robot = load_robot(arm)

    def of(xml, **fields):
        return scenes.Scene("mine", mujoco.MjSpec.from_string(xml), robot, **{"object": "", **fields})

    fixed = text.replace("</worldbody>", '<body name="box"><geom type="sphere" size="0.1"/></body></worldbody>')
    for call, error, message in (
        (
            lambda: of(text.replace('<motor joint="elbow"', '<position joint="elbow"')),
            RobotError,
            "'elbow' has no motor",
        ),
        (lambda: of(text.replace('"elbow"', '"elbo"')), UnknownNameError, "unknown joint.*'elbow'"),
        (lambda: of(text, hand="tipp"), UnknownNameError, "Did you mean 'tip'"),
        (lambda: of(text, may_touch=("box",)), UnknownNameError, "unknown geometry .*'box'"),
        (lambda: of(text, object="box"), UnknownNameError, "unknown object .*'box'"),
        (lambda: of(fixed, object="box"), ConfigurationError, "'box' cannot be placed. Make it a mocap body"),
        (lambda: of(text).left(None), ConfigurationError, "needs T_object_hand"),
    ):
        with pytest.raises(error, match=message):
            call()


def test_an_object_with_a_free_joint_is_placed_and_pushed(folder):
    spec = mujoco.MjSpec.from_file(str(folder / "arm.xml"))
    box = spec.worldbody.add_body(name="box")
    box.add_freejoint()
    box.add_geom(name="box", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.05, 0.05, 0.05])
    T = np.eye(4)
    T[:3, 3] = [0.2, -0.5, 0.4]
    place = scenes.Scene("box", spec, load_robot(folder / "arm.xml"), "tip", "box", T, may_touch=("box",))
    data = place.data(START)
    np.testing.assert_allclose(place.object_pose(data), T)
    tip = np.asarray(ControlPoints(place.robot, "tip")(jnp.asarray(START, jnp.float32))[0])
    np.testing.assert_allclose(place.hand_pose(data)[:3, 3], tip, atol=1e-6)
    mujoco.mj_step(place.model, data, 100)
    assert place.object_pose(data)[2, 3] < 0.37  # it falls, and its frame with it
