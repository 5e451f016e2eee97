"""Files that are in another encoding or are of another kind than a robot's."""

import pytest

from jaxrmp._errors import RobotError
from jaxrmp.kinematics import load_robot

URDF = """<?xml version="1.0"{}?><robot name="r"><link name="a"/><link name="b"/><joint name="größe" type="continuous">
<parent link="a"/><child link="b"/></joint></robot>"""
MJCF = """<?xml version="1.0"{}?><mujoco><worldbody><body><joint name="größe"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("text", [URDF, MJCF])
@pytest.mark.parametrize("declared", ["utf-8", "latin-1", "cp1252", "utf-16", ""])
def test_a_declared_encoding_is_honoured(text, declared, tmp_path):
    path = tmp_path / "arm.xml"
    declaration = f' encoding="{declared}"' if declared else ""
    path.write_bytes(text.format(declaration).encode(declared or "utf-8-sig"))
    assert load_robot(path).joint_names == ("größe",)


@pytest.mark.parametrize("text", [URDF, MJCF])
@pytest.mark.parametrize(
    ("declared", "actual", "message"),
    [
        ("", "latin-1", r"it is not UTF-8 text .* declare its encoding"),
        ("utf-8", "latin-1", r"it is not UTF-8 text"),
        ("klingon", "utf-8", "declares the encoding 'klingon', which is not known"),
    ],
)
def test_another_encoding_than_the_declared_one_is_refused(text, declared, actual, message, tmp_path):
    path = tmp_path / "arm.xml"
    path.write_bytes(text.format(f' encoding="{declared}"' if declared else "").encode(actual))
    with pytest.raises(RobotError, match=message):
        load_robot(path)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        (
            "arm.urdf.xacro",
            '<robot name="r"><xacro:include filename="x"/></robot>',
            r"arm\.urdf\.xacro is a xacro file.*`xacro FILE > robot",
        ),
        ("arm.urdf", '<robot><link name="${prefix}base"/></robot>', r"xacro's \$ expressions.* Run `xacro"),
        ("arm.urdf", '<robot><link name="a"/><joint name="j"><origin xyz="$(arg x)"/></joint></robot>', "Run `xacro"),
        ("arm.urdf", "", "is empty"),
        ("arm.urdf", " \n", "is empty"),
        ("arm.urdf", "<!DOCTYPE html>\n<html><body/></html>", "is a web page"),
        ("arm.sdf", "<?xml version='1.0'?><sdf version='1.6'/>", "is an SDF model"),
        ("arm.dae", "<COLLADA/>", "is a mesh"),
        ("arm.xml", "<mujocoinclude/>", "is a part of an MJCF model"),
        ("arm.xml", "<model/>", r"begins with <model>\. URDF begins with <robot>"),
    ],
)
def test_what_is_no_robot_is_named(name, text, message, tmp_path):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(RobotError, match=message):
        load_robot(path)


def test_a_comment_with_xacro_in_it_is_no_macro(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(URDF.format("").replace("<link", "<!-- <xacro:arm/> --><link", 1), "utf-8")
    assert load_robot(path).num_joints == 1


def test_a_namespace_is_no_other_format(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(URDF.format("").replace("<robot", '<robot xmlns="http://drake.mit.edu"'), "utf-8")
    assert load_robot(path).joint_names == ("größe",)
