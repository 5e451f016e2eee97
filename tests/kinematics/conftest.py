"""Robots for the kinematics tests, each with MuJoCo's own model of the same file as the oracle."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from jaxrmp.kinematics import PANDA_MODEL, load_robot, panda

MODELS = Path(__file__).parent / "models"


class Oracle:
    """MuJoCo's model of a robot file, driven by the independent joints."""

    def __init__(self, model, robot, positions, slopes):
        self.model, self.data, self.robot = model, mujoco.MjData(model), robot
        self._positions, self._slopes = positions, slopes  # of the joints that are not independent

    def set(self, q, qd=None):
        own = dict(zip(self.robot.joint_names, np.asarray(q, float), strict=True))
        for name, value in {**own, **self._positions(own)}.items():
            self.data.qpos[self.model.joint(name).qposadr[0]] = value
        if qd is not None:
            self.data.qvel[:] = self.expansion() @ np.asarray(qd, float)
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_comVel(self.model, self.data)

    def expansion(self):
        """[nv, n]: how all joints' velocities follow from the independent ones'."""
        E = np.zeros((self.model.nv, self.robot.num_joints))
        for i, name in enumerate(self.robot.joint_names):
            E[self.model.joint(name).dofadr[0], i] = 1.0
        for name, (leader, slope) in self._slopes.items():
            E[self.model.joint(name).dofadr[0], self.robot.joint_index(leader)] = slope
        return E

    def pose(self, frame):
        d, m = self.data, self.model
        site = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_SITE, frame.removeprefix("site:"))
        body = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_BODY, frame)
        T = np.eye(4)
        if body >= 0:
            T[:3, :3], T[:3, 3] = d.xmat[body].reshape(3, 3), d.xpos[body]
        else:
            T[:3, :3], T[:3, 3] = d.site_xmat[site].reshape(3, 3), d.site_xpos[site]
        return T

    def jacobians(self, frame, point):
        """J [3, n] and Jdot [3, n] of a world point that moves with the frame's body."""
        body = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, frame)
        if body < 0:
            body = self.model.site(frame.removeprefix("site:")).bodyid[0]
        J, Jdot = np.zeros((3, self.model.nv)), np.zeros((3, self.model.nv))
        mujoco.mj_jac(self.model, self.data, J, None, point, body)
        mujoco.mj_jacDot(self.model, self.data, Jdot, None, point, body)
        return J @ self.expansion(), Jdot @ self.expansion()


def _panda_case():
    fingers = {"panda_finger_joint1": 0.04, "panda_finger_joint2": 0.04}
    return Oracle(mujoco.MjModel.from_xml_path(str(PANDA_MODEL)), panda(), lambda q: fingers, {})


def _branching_case():
    # MuJoCo reads the same file; only the mesh, whose file is absent on purpose, is taken out beforehand.
    path = MODELS / "branching.xml"
    text = path.read_text().replace('<geom type="mesh" mesh="absent"/>', '<geom size="0.1"/>')
    text = text.replace('<mesh name="absent" file="nowhere/absent.stl"/>', "")

    def followers(q):
        grip = 0.02 + 0.01 - 0.5 * (q["right_reach"] - 0.1)
        return {"right_grip": grip, "right_hook": np.deg2rad(12) + 0.1 + 3 * (grip - 0.02)}

    slopes = {"right_grip": ("right_reach", -0.5), "right_hook": ("right_reach", -1.5)}
    return Oracle(mujoco.MjModel.from_xml_string(text), load_robot(path), followers, slopes)


@pytest.fixture(scope="session", params=["panda", "branching"])
def oracle(request):
    return {"panda": _panda_case, "branching": _branching_case}[request.param]()


@pytest.fixture(scope="session")
def branching():
    return load_robot(MODELS / "branching.xml")


@pytest.fixture(scope="session")
def random_configurations():
    """A function that draws [count, n] joint positions within a robot's limits."""

    def draw(robot, count, seed=0):
        low, high = np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0)
        return np.random.default_rng(seed).uniform(low, high, (count, robot.num_joints))

    return draw
