"""Links that may touch, as MoveIt's SRDF says."""

import itertools

import pytest

from jaxrmp import RobotError
from jaxrmp.kinematics import load_robot

LINKS = ("base", "upper", "fore", "wrist", "hand")
SRDF = """<?xml version="1.0"?><robot name="arm">
  <group name="arm"><chain base_link="base" tip_link="hand"/></group>
  <disable_collisions link1="base" link2="fore" reason="Never"/>
  <disable_collisions link1="wrist" link2="gone" reason="Adjacent"/>
</robot>"""


@pytest.fixture
def urdf(tmp_path):
    links = "".join(
        f'<link name="{n}"><collision><geometry><sphere radius="0.02"/></geometry></collision></link>' for n in LINKS
    )
    joints = "".join(
        f'<joint name="j{k}" type="continuous"><parent link="{a}"/><child link="{b}"/><origin xyz="0.3 0 0"/></joint>'
        for k, (a, b) in enumerate(itertools.pairwise(LINKS))
    )
    path = tmp_path / "arm.urdf"
    path.write_text(f'<robot name="arm">{links}{joints}</robot>')
    return path


def ignored(robot):
    return {frozenset(pair) for pair in robot.model.ignore}


@pytest.mark.filterwarnings("ignore::jaxrmp.FileWarning")
def test_links_that_may_touch_are_read_beside_those_that_are_said(urdf, tmp_path):
    (tmp_path / "arm.srdf").write_text(SRDF)
    robot = load_robot(urdf, srdf=tmp_path / "arm.srdf", ignore={"upper": ["wrist"]})
    assert ignored(robot) == {frozenset(("base", "fore")), frozenset(("upper", "wrist"))}
    (tmp_path / "arm.toml").write_text('file = "arm.urdf"\nsrdf = "arm.srdf"\n')
    assert ignored(load_robot(tmp_path / "arm.toml")) == {frozenset(("base", "fore"))}


@pytest.mark.filterwarnings("ignore::jaxrmp.FileWarning")
def test_a_link_may_touch_all_but_some(urdf, tmp_path):
    all_but = '<disable_default_collisions link="hand"/><enable_collisions link1="base" link2="hand"/>'
    (tmp_path / "arm.srdf").write_text(f"<robot>{all_but}</robot>")
    found = ignored(load_robot(urdf, srdf=tmp_path / "arm.srdf"))
    assert frozenset(("hand", "fore")) in found and frozenset(("hand", "base")) not in found


@pytest.mark.filterwarnings("ignore::jaxrmp.FileWarning")
@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("<robot", "cannot be read as SRDF"),
        ('<robot name="arm"><link name="base"/></robot>', "is no SRDF"),
        ('<robot><disable_collisions link1="base"/></robot>', "lacks link2"),
        ('<robot><disable_collisions link1="torso" link2="head"/></robot>', "of another robot"),
    ],
)
def test_what_is_no_srdf_of_the_robot_is_told(urdf, tmp_path, text, why):
    (tmp_path / "arm.srdf").write_text(text)
    with pytest.raises(RobotError, match=why):
        load_robot(urdf, srdf=tmp_path / "arm.srdf")
