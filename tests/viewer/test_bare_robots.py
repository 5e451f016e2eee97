"""Pages of robots whose files say little: no inertias, no meshes, no geometry at all."""

import pytest

from jaxrmp import FileWarning

BARE = """<robot name="bare"><link name="base"/><link name="shoulder"/><link name="upper">{}</link><link name="tool"/>
<joint name="pan" type="continuous"><parent link="base"/><child link="shoulder"/><origin xyz="0 0 0.2"/></joint>
<joint name="lift" type="continuous"><parent link="shoulder"/><child link="upper"/><axis xyz="0 1 0"/></joint>
<joint name="flange" type="fixed"><parent link="upper"/><child link="tool"/><origin xyz="0.3 0 0"/></joint></robot>"""
BOX = "<{0}><origin xyz='0.15 0 0'/><geometry>{1}</geometry></{0}>"


@pytest.fixture
def page(tmp_path):
    """Opens and closes the page of an arm whose link `upper` has what is given: its frames, and its notes."""
    pytest.importorskip("viser")
    from jaxrmp.viewer import Viewer, reach_content

    def open_page(upper):
        path = tmp_path / "arm.urdf"
        path.write_text(BARE.format(upper))
        viewer = Viewer(reach_content(str(path), "tool"), port=0)
        viewer.server.stop()
        return viewer.arm.frames, [note.content for note in viewer.notes]

    return open_page


def test_an_arm_without_inertias_is_shown(page):
    assert page(BOX.format("collision", "<box size='0.3 0.06 0.06'/>")) == (("upper", "tool"), [])


@pytest.mark.parametrize(
    ("upper", "why"),
    [
        (BOX.format("collision", "<mesh filename='package://gone/upper.stl'/>"), "package://gone/upper.stl.*packages="),
        ("", "has no geometry"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*avoids neither")
def test_an_arm_whose_looks_are_not_there_is_a_skeleton_that_says_so(page, upper, why):
    with pytest.warns(FileWarning, match=f"'bare' is drawn as a skeleton: .*{why}"):
        frames, (looks, avoids) = page(upper)
    assert set(frames) == {"base", "shoulder", "upper", "tool"}
    assert "drawn as a skeleton" in looks and "avoids nothing" in avoids


def test_each_link_is_drawn_by_its_visual_geometry_if_it_has_any(tmp_path):
    from jaxrmp.viewer._shapes import seen
    from jaxrmp.world import geometry_of_model

    path = tmp_path / "arm.urdf"
    both = BOX.format("collision", "<box size='1 1 1'/>") + BOX.format("visual", "<sphere radius='1'/>")
    tool = BOX.format("collision", "<box size='2 2 2'/>")
    path.write_text(BARE.format(both).replace('<link name="tool"/>', f'<link name="tool">{tool}</link>'))
    model = geometry_of_model(path, looks=True)
    names = [model.body(model.geom_bodyid[g]).name for g in seen(model)]
    assert (model.ngeom, names) == (3, ["upper", "tool"])


def test_of_a_file_with_more_in_it_the_robot_alone_is_drawn(tmp_path):
    pytest.importorskip("viser")
    from jaxrmp.kinematics import load_robot
    from jaxrmp.viewer._arm import _looks

    path = tmp_path / "two.xml"
    arm = '<body name="{0}"><joint axis="0 0 1" range="-1 1"/><geom size=".1"/></body>'
    path.write_text(f"<mujoco><worldbody>{arm.format('left')}{arm.format('right')}</worldbody></mujoco>")
    shapes, note = _looks(load_robot(path, root="right"))
    assert ([name for name, _ in shapes], note) == (["right"], "")
