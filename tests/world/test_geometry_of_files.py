"""The geometry of a robot's file: without inertias, with meshes of ROS packages, of other formats, and absent ones."""

import shutil

import numpy as np
import pytest

from jaxrmp import FileWarning
from jaxrmp._errors import RobotError
from jaxrmp.kinematics import load_robot
from jaxrmp.world import geometry_of_model, own_spheres, spheres_from_model

ARM = """<robot name="arm">
<link name="base"/><link name="shoulder">{inertia}</link>
<link name="upper">{upper}</link><link name="tool"/>
<joint name="pan" type="continuous"><parent link="base"/><child link="shoulder"/></joint>
<joint name="lift" type="continuous"><parent link="shoulder"/><child link="upper"/></joint>
<joint name="flange" type="fixed"><parent link="upper"/><child link="tool"/><origin xyz="0.3 0 0"/></joint></robot>"""
BOX = "<collision><geometry><box size='0.3 0.06 0.06'/></geometry></collision>"
INERTIA = "<inertial><mass value='{}'/><inertia ixx='{}' ixy='0' ixz='0' iyy='{}' iyz='0' izz='{}'/></inertial>"


def mesh(name, kind="collision", more=""):
    return f"<{kind} name='{kind}'><geometry><mesh filename='{name}' {more}/></geometry></{kind}>"


@pytest.fixture
def arm(tmp_path):
    """Writes an arm to robots/bar_description/urdf/arm.urdf, whose link `upper` has what is given."""
    folder = tmp_path / "robots" / "bar_description"
    for name in ("urdf", "meshes"):
        (folder / name).mkdir(parents=True)

    def write(upper, inertia=""):
        path = folder / "urdf" / "arm.urdf"
        path.write_text(ARM.format(upper=upper, inertia=inertia))
        return path

    return write


def box(path, size=(0.2, 0.1, 0.1)):
    creation = pytest.importorskip("trimesh").creation
    path.parent.mkdir(parents=True, exist_ok=True)
    creation.box(size).export(path)
    return path


def sizes(model, body="upper"):
    """Of the geometries of a body, how far their vertices reach along the axes of the mesh, sorted."""
    found = []
    for g in np.flatnonzero(model.geom_bodyid == model.body(body).id):
        first, count = (a[model.geom_dataid[g]] for a in (model.mesh_vertadr, model.mesh_vertnum))
        found.append(sorted(np.round(np.ptp(model.mesh_vert[first : first + count].astype(float), axis=0), 4).tolist()))
    return sorted(found)


@pytest.mark.parametrize(
    "inertia",
    ["", INERTIA.format(0, 0, 0, 0), INERTIA.format(1, 1, 1, 3), INERTIA.format("nan", 1, 1, 1), "<inertial/>"],
)
def test_geometry_needs_no_inertia(inertia, arm):
    path = arm(BOX, inertia)
    spheres = spheres_from_model(path, 0.03)
    assert set(spheres.frames) == {"upper"} and spheres.size == 4
    assert own_spheres(load_robot(path)).size >= 4


@pytest.mark.parametrize(
    "name",
    [
        "package://bar_description/meshes/bar.stl",
        "model://bar_description/meshes/bar.stl",
        "package://robots/bar_description/meshes/bar.stl",
        "../meshes/bar.stl",
        "..\\meshes\\bar.stl",
    ],
)
def test_a_package_is_found_round_the_file(name, arm, tmp_path):
    box(tmp_path / "robots/bar_description/meshes/bar.stl")
    path = arm(mesh(name))
    assert sizes(geometry_of_model(path)) == [[0.1, 0.1, 0.2]]
    assert spheres_from_model(load_robot(path), 0.03).size == spheres_from_model(path, 0.03).size


def test_a_package_is_found_by_its_manifest(arm, tmp_path):
    box(tmp_path / "robots/bar_description/meshes/bar.stl")
    (tmp_path / "robots/bar_description/package.xml").write_text("<package><name> bar </name></package>")
    assert sizes(geometry_of_model(arm(mesh("package://bar/meshes/bar.stl")))) == [[0.1, 0.1, 0.2]]


def test_a_package_elsewhere_is_found_by_argument_and_environment(arm, tmp_path, monkeypatch):
    there = tmp_path / "elsewhere"
    box(there / "share/far/meshes/bar.stl")
    path = arm(mesh("package://far/meshes/bar.stl"))
    assert load_robot(path).num_joints == 2
    with pytest.raises(
        RobotError,
        match=r"mesh 'package://far/meshes/bar.stl' of link 'upper' is not there.*`packages.far = \"FOLDER\"` in a "
        r"robot file, .*which configurations take as robot and commands as --robot; .*packages=\{'far': folder\}",
    ):
        spheres_from_model(path, 0.03)
    given = {"far": there / "share/far"}
    expected = spheres_from_model(path, 0.03, packages=given).size
    robot = load_robot(path, packages=given)
    assert spheres_from_model(robot, 0.03).size == expected and own_spheres(robot).size > 0
    assert robot.model == load_robot(path).model
    for variable, value in (
        ("ROS_PACKAGE_PATH", there / "share"),
        ("ROS_PACKAGE_PATH", there),
        ("AMENT_PREFIX_PATH", there),
    ):
        monkeypatch.setenv(variable, str(value))
        assert spheres_from_model(path, 0.03).size == expected
        monkeypatch.delenv(variable)
    with pytest.raises(RobotError, match=r"packages\['far'\] is 'nowhere', which is no folder"):
        load_robot(path, packages={"far": "nowhere"})


def test_two_meshes_of_one_name_stay_two(arm, tmp_path):
    box(tmp_path / "robots/bar_description/meshes/visual/bar.stl", (0.4, 0.2, 0.2))
    box(tmp_path / "robots/bar_description/meshes/collision/bar.STL")
    inside = mesh("../meshes/visual/bar.stl", "visual") + mesh("../meshes/collision/bar.STL")
    inside += mesh("../meshes/collision/bar.STL", more="scale='2 1 1'")
    collides = [[0.1, 0.1, 0.2], [0.1, 0.1, 0.4]]
    assert sizes(geometry_of_model(arm(inside), looks=True)) == [*collides, [0.2, 0.2, 0.4]]
    assert sizes(geometry_of_model(arm(inside))) == collides


def test_a_visual_mesh_that_is_not_there_is_left_out_where_it_is_not_needed(arm):
    path = arm(mesh("package://gone/a.dae", "visual") + BOX)
    assert spheres_from_model(path, 0.03).size == 4
    with pytest.warns(FileWarning, match=r"left out: package://gone/a\.dae \(link 'upper'\)"):
        assert geometry_of_model(path, looks=True).ngeom == 1
    with pytest.raises(RobotError, match="the visual mesh 'package://gone/a.dae' of link 'upper' is not there"):
        geometry_of_model(arm(mesh("package://gone/a.dae", "visual")))


@pytest.mark.parametrize("kind", ["dae", "ply", "stl_ascii"])
def test_meshes_that_mujoco_cannot_read_are_converted(kind, arm, tmp_path):
    if kind == "dae":
        pytest.importorskip("collada")
    path = tmp_path / "robots/bar_description/meshes" / f"bar.{kind.removesuffix('_ascii')}"
    data = pytest.importorskip("trimesh").creation.box((0.2, 0.1, 0.1)).export(file_type=kind)
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    assert sizes(geometry_of_model(arm(mesh(f"../meshes/{path.name}")))) == [[0.1, 0.1, 0.2]]
    mjcf = tmp_path / "robots/bar_description/arm.xml"
    mjcf.write_text(
        f"<mujoco><compiler meshdir='meshes'/><asset><mesh name='m' file='{path.name}'/></asset><worldbody>"
        "<body name='upper'><joint/><geom type='mesh' mesh='m'/></body></worldbody></mujoco>"
    )
    assert sizes(geometry_of_model(mjcf)) == [[0.1, 0.1, 0.2]]


def test_the_unit_of_a_collada_file_counts(arm, tmp_path):
    pytest.importorskip("collada")
    data = pytest.importorskip("trimesh").creation.box((200, 100, 100)).export(file_type="dae").decode()
    path = tmp_path / "robots/bar_description/meshes/bar.dae"
    path.write_text(data.replace("<asset>", '<asset><unit meter="0.001" name="mm"/>', 1))
    assert sizes(geometry_of_model(arm(mesh("../meshes/bar.dae")))) == [[0.1, 0.1, 0.2]]


def test_a_damaged_mesh_is_named(arm, tmp_path):
    (tmp_path / "robots/bar_description/meshes/bar.ply").write_text("ply\nnonsense")
    with pytest.raises(RobotError, match=r"bar\.ply cannot be read"):
        geometry_of_model(arm(mesh("../meshes/bar.ply")))
    (tmp_path / "robots/bar_description/meshes/bar.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n"
    )
    with pytest.raises(RobotError, match=r"coplanar vertices.*bar\.obj"):
        geometry_of_model(arm(mesh("../meshes/bar.obj")))


@pytest.mark.parametrize(
    ("upper", "message"),
    [
        ("<collision/>", "a collision of link 'upper' has no geometry"),
        (BOX.replace("0.06", "0"), "must be positive .*of body 'upper'"),
    ],
)
def test_damaged_geometry_is_named(upper, message, arm):
    with pytest.raises(RobotError, match=message):
        geometry_of_model(arm(upper))


def test_an_absent_mesh_of_an_mjcf_is_named(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(
        "<mujoco><asset><mesh name='m' file='gone.stl'/></asset><worldbody><body name='upper'><joint/>"
        "<geom type='mesh' mesh='m'/></body></worldbody></mujoco>"
    )
    with pytest.raises(RobotError, match=r"opening file 'gone\.stl'.* mesh of \['upper'\]: put it there"):
        geometry_of_model(path)
    assert load_robot(path).num_joints == 1


def test_a_robot_that_moves_on_disk_says_that_its_geometry_is_gone(arm, tmp_path):
    robot = load_robot(arm(BOX))
    shutil.rmtree(tmp_path / "robots")
    with pytest.raises(RobotError, match="there is no such file"):
        geometry_of_model(robot)


def test_the_geometry_of_a_robot_is_read_once_and_anew_when_it_is_loaded_again(arm):
    path = arm("<collision><geometry><sphere radius='0.1'/></geometry></collision>")
    robot = load_robot(path)
    once = geometry_of_model(robot)
    assert geometry_of_model(robot) is once and geometry_of_model(robot, looks=True) is not once
    path.write_text(path.read_text().replace("0.1", "0.2"))
    assert geometry_of_model(load_robot(path)).geom_size[0, 0] == 0.2
