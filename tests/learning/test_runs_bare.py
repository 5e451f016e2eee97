"""What `pip install jaxrmp` alone runs: skills of both methods, on their own robots, with jax and numpy only."""

from dataclasses import replace

import jax
import numpy as np
import pytest

import jaxrmp
from jaxrmp import acceleration
from jaxrmp.kinematics import PANDA_MODEL, load_robot, panda, record_of
from jaxrmp.learning import load_skill, save_skill
from jaxrmp.policies import reaching_policy, whole_arm_policy
from jaxrmp.world import Spheres, World

Q = np.array([0.1, -0.6, 0.2, -2.0, 0.1, 1.6, 0.7], np.float32)


def test_the_bare_environment_is_bare(run_bare):
    found = run_bare(
        """
import importlib.util as u, json, jaxrmp
names = ("mujoco", "flax", "optax", "cvxpy", "clarabel", "matplotlib", "tqdm", "shtab", "yaml", "pyarrow", "h5py",
         "rosbags", "viser", "trimesh", "torch", "flatbuffers", "pytest", "pip")
print(json.dumps({"there": [n for n in names if u.find_spec(n)], "jaxrmp": jaxrmp.__version__}))
""",
    )
    assert found == {"there": [], "jaxrmp": jaxrmp.__version__}


SKILL = """
import json, sys
import jax, numpy as np
from jaxrmp import acceleration, certificate, compiled
from jaxrmp.learning import load_skill
skill = load_skill(sys.argv[1])
q, qd = np.array(json.loads(sys.argv[2]), np.float32), np.zeros(len(json.loads(sys.argv[2])), np.float32)
robot = skill.load_robot()
tree = skill.tree(robot)
act = compiled(lambda q, qd: acceleration(tree, q, qd), q, qd)
left = sorted({name.split(".")[0] for name in sys.modules} & {"mujoco", "flax", "optax", "cvxpy"})
print(json.dumps({"qdd": act(q, qd).tolist(), "own": skill.robot.fingerprint == robot.fingerprint, "left": left,
                  "residual": float(jax.jit(certificate)(tree, q, qd).residual), "name": robot.name}))
"""


@pytest.mark.parametrize("method", ["paper", "flow"])
def test_a_skill_of_the_panda_runs_bare(run_bare, drawer_skill, door_flow, tmp_path, method):
    skill = drawer_skill if method == "paper" else door_flow.skill
    file = save_skill(skill, tmp_path / "reach.skill.npz")
    found = run_bare(SKILL, file, Q.tolist())
    here = jax.jit(acceleration)(load_skill(file).tree(skill.load_robot()), Q, 0 * Q)
    assert skill.method == method and found["own"] and found["left"] == [] and found["name"] == "panda"
    np.testing.assert_allclose(found["qdd"], here, rtol=2e-3, atol=2e-3)  # by programs that XLA fuses otherwise
    assert abs(found["residual"]) < 1e-2


@pytest.fixture
def of_file(drawer_skill, tmp_path):
    """A skill that was learned on the robot of a file, and that file."""
    file = tmp_path / "arm.xml"
    file.write_text(PANDA_MODEL.read_text())
    fixed = {"panda_finger_joint1": 0.04, "panda_finger_joint2": 0.04}
    configuration = replace(drawer_skill.configuration, robot=str(file), fixed_joints=fixed)
    robot = load_robot(file, fixed=fixed, name="arm")
    return replace(drawer_skill, configuration=configuration, robot_record=record_of(robot)), file


@pytest.mark.parametrize("there", [True, False])
def test_a_skill_of_a_robot_of_a_file_runs_bare(run_bare, of_file, tmp_path, there):
    skill, file = of_file
    if not there:
        file.unlink()
    found = run_bare(SKILL, save_skill(skill, tmp_path / "reach.skill.npz"), Q.tolist())
    here = jax.jit(acceleration)(skill.tree(skill.robot), Q, 0 * Q)
    assert found["name"] == "arm" and found["left"] == []
    np.testing.assert_allclose(found["qdd"], here, rtol=2e-3, atol=2e-3)


def test_what_needs_more_says_so(run_bare, of_file, tmp_path):
    skill, _ = of_file
    old = save_skill(replace(skill, robot_record=None), tmp_path / "old.skill.npz")
    found = run_bare(
        """
import json, sys
import jax, numpy as np, jaxrmp
from jaxrmp import export, kinematics, learning, policies, scenes, simulation, synthetic
skill = learning.load_skill(sys.argv[1])
def told(function, *arguments):
    try:
        function(*arguments)
    except jaxrmp.MissingDependencyError as error:
        return str(error)
zeros = np.zeros((1, 4, 3), np.float32)
print(json.dumps([
    told(skill.load_robot),
    told(kinematics.load_robot, kinematics.PANDA_MODEL),
    told(learning.initial_cholesky_factor, jax.random.key(0)),
    told(learning.train_metrics, zeros, zeros, zeros),
    told(learning.train_flow, [np.linspace([1.0, 1.0, 1.0], [0.0, 0.0, 0.0], 50)], np.zeros((0, 3))),
    told(export.stablehlo, lambda q: q, np.zeros(7)),
]))
""",
        old,
    )
    found = [f"{message.partition(', or, in a clone of jaxrmp, pip install -e')[0]}." for message in found]
    start, robot = "mujoco is needed for robot ", "and is not installed: pip install 'jaxrmp[robots]'."
    assert found[0].startswith(start) and found[0].endswith(
        f"which a skill file before version 8 does not hold, {robot}"
    )
    assert found[1] == f"mujoco is needed for this {robot}"
    learned = [
        f"{name} is needed for this and is not installed: pip install 'jaxrmp[learning]'." for name in ("flax", "optax")
    ]
    assert found[2:5] == [learned[0], learned[1], learned[1]]
    assert found[5] == "flatbuffers is needed for this and is not installed: pip install 'jaxrmp[export]'."


WHOLE = """
import json, sys, warnings
import jax, numpy as np
warnings.simplefilter("error")
from jaxrmp import acceleration, compiled
from jaxrmp.learning import load_skill
from jaxrmp.policies import reaching_policy, whole_arm_policy
from jaxrmp.world import Spheres, World
skill = load_skill(sys.argv[1])
q = np.array(json.loads(sys.argv[2]), np.float32)
robot, T = skill.load_robot(), np.asarray(skill.T_world_object)
world = World(spheres=Spheres.of([((0.4, 0.1, 0.5), 0.05)]))
found = []
for policy in (whole_arm_policy(skill, robot), reaching_policy(robot, "panda_hand_tcp")):
    act = compiled(lambda T, q, qd, policy=policy: acceleration(policy.tree(T, world), q, qd), T, q, q)
    found.append(act(T, q, 0 * q).tolist())
print(json.dumps({"found": found, "left": sorted({"mujoco", "flax", "optax", "cvxpy"} & set(sys.modules))}))
"""


def test_a_whole_arm_runs_bare(run_bare, door_flow, tmp_path):
    skill, robot = door_flow.skill, panda()
    found = run_bare(WHOLE, save_skill(skill, tmp_path / "reach.skill.npz"), Q.tolist())
    assert found["left"] == []
    world = World(spheres=Spheres.of([((0.4, 0.1, 0.5), 0.05)]))
    for qdd, policy in zip(
        found["found"], (whole_arm_policy(skill, robot), reaching_policy(robot, "panda_hand_tcp")), strict=True
    ):
        here = jax.jit(acceleration)(policy.tree(skill.T_world_object, world), Q, 0 * Q)
        np.testing.assert_allclose(qdd, here, rtol=2e-3, atol=2e-3)
