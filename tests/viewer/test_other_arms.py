"""Pages of arms unlike the Panda: of five joints with a gripper, and of two arms on wheels."""

import numpy as np
import pytest

LINK = "<link name='{0}'><{1}><origin xyz='0 0 0.1'/><geometry><box size='0.04 0.04 0.2'/></geometry>{2}</{1}></link>"
YELLOW = "<material name='yellow'><color rgba='1 0.8 0 1'/></material>"
JOINT = """<joint name="{1}" type="revolute"><parent link="{0}"/><child link="{1}"/><origin xyz="{2}"/><axis xyz="{3}"/>
<limit lower="-1.2" upper="2" velocity="3" effort="9"/></joint>"""


def chain(base, names, axes, first):
    """Links one on the other, each with a joint of its own name."""
    text, parent, at = "", base, first
    for name, axis in zip(names, axes, strict=True):
        text += LINK.format(name, "visual", YELLOW) + JOINT.format(parent, name, at, axis)
        parent, at = name, "0 0 0.2"
    return text


def five_with_a_gripper():
    names, axes = ("pan", "lift", "elbow", "flex", "roll"), ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1")
    jaw = LINK.format("jaw", "collision", "") + JOINT.format("roll", "gripper_jaw", "0.05 0 0.2", "0 1 0").replace(
        'child link="gripper_jaw"', 'child link="jaw"'
    )
    tip = '<link name="tool0"/><joint name="tip" type="fixed"><parent link="roll"/><child link="tool0"/>'
    tip += '<origin xyz="0 0 0.3"/></joint>'
    return f'<robot name="five"><link name="base"/>{chain("base", names, axes, "0 0 0")}{jaw}{tip}</robot>'


def two_on_wheels():
    sides = ""
    for side, y in (("left", 0.25), ("right", -0.25)):
        names = tuple(f"{side}_{part}" for part in ("pan", "lift", "elbow"))
        sides += chain("base", names, ("0 0 1", "0 1 0", "0 1 0"), f"0 {y} 0.3")
        sides += f'<link name="{side}_palm"/><joint name="{side}_tip" type="fixed"><parent link="{side}_elbow"/>'
        sides += f'<child link="{side}_palm"/><origin xyz="0 0 0.25"/></joint>'
    wheel = '<link name="tyre"/><joint name="wheel" type="continuous"><parent link="base"/><child link="tyre"/></joint>'
    return f'<robot name="two"><link name="base"/>{wheel}{sides}</robot>'


ROBOTS = {
    "five": (five_with_a_gripper, "tool0", "gripper_jaw"),
    "two": (two_on_wheels, "right_palm", "wheel"),
}


@pytest.fixture(scope="module", params=ROBOTS)
def viewer(request, tmp_path_factory):
    """The page's session of a robot as `jaxrmp view --robot` makes it, its hand, and what the command said."""
    pytest.importorskip("viser")
    import contextlib
    import io

    from jaxrmp.cli._sources import robot_of
    from jaxrmp.viewer import Viewer, reach_content

    text, hand, idle = ROBOTS[request.param]
    file = tmp_path_factory.mktemp("robot") / "robot.urdf"
    file.write_text(text())
    with contextlib.redirect_stderr(io.StringIO()) as said:
        robot = robot_of(str(file), None, None)
    assert f"locked, for they move no hand: {idle}." in said.getvalue()
    viewer = Viewer(reach_content(robot, balls=1), 0)
    viewer.start()
    yield viewer, hand
    viewer.stop()


@pytest.mark.filterwarnings("ignore:some rows")
def test_the_hand_goes_where_its_goal_is_dragged_and_the_arm_keeps_off_the_ball(viewer, page_of):
    viewer, hand = viewer
    page = page_of(viewer)
    assert viewer.content.hand == hand
    assert {colour for name, colour in page.colours.items() if "jaw" not in name} == {(255, 204, 0)}
    goal = viewer.content.T_world_target.copy()
    goal[:3, 3] += [-0.05, -0.1, -0.04]
    page.drag("/target", goal)

    def missed() -> float:
        return float(np.linalg.norm(page.nodes[f"/arm/{hand}"][:3, 3] - goal[:3, 3]))

    page.wait(lambda: missed() < 0.004, "the hand at its goal", 60)
    spheres, ball = viewer.content.policy.spheres, goal.copy()

    def distance() -> float:
        T = np.stack([page.nodes[f"/arm/{name}"] for name in spheres.frames])
        at = np.einsum("kij,kj->ki", T[:, :3, :3], np.asarray(spheres.offsets)) + T[:, :3, 3]
        return float(
            (np.linalg.norm(at - page.nodes["/solid_1"][:3, 3], axis=1) - np.asarray(spheres.radii) - 0.06).min()
        )

    ball[:3, 3] += [0.0, -0.25, 0.0]
    page.drag("/obstacle_1", ball)
    page.wait(lambda: np.allclose(page.nodes["/solid_1"][:3, 3], ball[:3, 3], atol=1e-3), "the ball there")
    near = []
    page.on_frame = lambda: near.append(distance())
    for _ in range(20):  # 20 cm towards the hand, slowly
        ball[1, 3] += 0.01
        page.drag("/obstacle_1", ball)
        page.page.wait_for_timeout(100)
    page.wait(lambda: missed() > 0.01, "the hand to give way")
    assert min(near) > 0
    page.on_frame = lambda: None
    ball[0, 3] = np.nan
    page.drag("/obstacle_1", ball)
    page.page.get_by_text("1 obstacle not finite, ignored").first.wait_for()
    page.wait(lambda: missed() < 0.004, "the hand to come back", 60)
    assert page.errors == []
