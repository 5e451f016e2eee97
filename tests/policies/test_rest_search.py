"""Where arms wait: not stretched out, not within themselves, above what they stand on; and where they were, if good."""

import numpy as np
import pytest

from jaxrmp import ConfigurationError, ShapeError
from jaxrmp.kinematics import forward_kinematics, geometric_jacobian, load_robot
from jaxrmp.policies import find_rest
from jaxrmp.world import RobotSpheres, own_self_pairs, own_spheres

LINK = """<link name='{0}'><collision><origin xyz='0 0 0.1'/><geometry>
<box size='0.05 0.05 0.2'/></geometry></collision></link>"""
JOINT = """<joint name="j{1}" type="revolute"><parent link="{0}"/><child link="{1}"/><origin xyz="{2}"/>
<axis xyz="{3}"/><limit lower="-3" upper="3" velocity="3" effort="9"/></joint>"""


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """Six joints, stretched straight up in the middle of their ranges; and a seventh that moves no hand."""
    text, parent = LINK.format("base"), "base"
    for k, axis in enumerate(("0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1")):
        text += LINK.format(f"l{k}") + JOINT.format(parent, f"l{k}", "0 0 0.2", axis)
        parent = f"l{k}"
    text += '<link name="lid"/>' + JOINT.format("base", "lid", "0.1 0 0", "0 1 0")
    file = tmp_path_factory.mktemp("robot") / "six.urdf"
    file.write_text(f'<robot name="six">{text}</robot>')
    return load_robot(file)


def least_singular_value(robot, q):
    J = np.asarray(geometric_jacobian(robot, np.asarray(q, np.float32), "l5"))[:, :6]
    return np.linalg.svd(J, compute_uv=False)[-1]


def test_an_arm_stretched_out_waits_elsewhere_clear_of_itself_and_above_its_base(robot):
    spheres, middle = own_spheres(robot), robot.middle
    pairs = own_self_pairs(robot, spheres)
    assert least_singular_value(robot, middle) < 1e-3
    rest = find_rest(robot, "l5", spheres, own=middle)
    assert least_singular_value(robot, rest) > 0.1
    assert (rest > np.asarray(robot.lower)).all() and (rest < np.asarray(robot.upper)).all()
    assert rest[robot.joint_index("jlid")] == 0
    at = np.asarray(spheres.points(robot)(rest.astype(np.float32)))
    i, j = np.array(pairs).T
    apart = np.linalg.norm(at[i] - at[j], axis=1) - np.asarray(spheres.radii)[i] - np.asarray(spheres.radii)[j]
    assert apart.min() > 0.004
    assert forward_kinematics(robot, rest.astype(np.float32), "l5")[2, 3] > 0
    np.testing.assert_array_equal(find_rest(robot, "l5", spheres, pairs, own=rest), rest)  # good as it is


def test_spheres_too_coarse_to_tell_are_an_error_or_leave_the_posture_that_there_is(robot):
    coarse = RobotSpheres(("base", "l2", "l5"), np.zeros((3, 3)), np.full(3, 2.0))
    pairs = ((0, 1), (0, 2), (1, 2))
    with pytest.raises(ConfigurationError, match="too coarse"):
        find_rest(robot, "l5", coarse, pairs)
    np.testing.assert_array_equal(find_rest(robot, "l5", coarse, pairs, own=robot.middle), robot.middle)


def test_a_posture_of_another_arm_is_told(robot):
    with pytest.raises(ShapeError, match=r"own has shape \(6,\), expected \(7,\)"):
        find_rest(robot, "l5", own=np.zeros(6))
