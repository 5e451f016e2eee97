"""Spheres generated from a model cover its geometry, stick out no farther than they say, and know which may meet."""

import mujoco
import numpy as np
import pytest

from jaxrmp import ConfigurationError, RobotError, UnknownNameError
from jaxrmp.kinematics import PANDA_MODEL, load_robot, panda
from jaxrmp.world import (
    RobotSpheres,
    SelfDistances,
    ignored_by_model,
    panda_self_pairs,
    panda_spheres,
    self_pairs,
    spheres_from_model,
)

SHAPES = {
    "sphere": 'type="sphere" size=".07"',
    "capsule": 'type="capsule" size=".05 .12"',
    "box": 'type="box" size=".1 .04 .02"',
    "cylinder": 'type="cylinder" size=".06 .08"',
    "ellipsoid": 'type="ellipsoid" size=".05 .08 .03"',
    "mesh": 'type="mesh" mesh="wedge"',
}
MODEL = """<mujoco><asset><mesh name="wedge" vertex="0 0 0  .2 0 0  0 .1 0  0 0 .1  .1 .1 .02"/></asset>
<worldbody><geom type="plane" size="1 1 1"/><body name="upper" pos="0 0 1"><joint/>
<geom {} pos=".1 .2 .3" euler="20 30 40"/><body name="lower"><joint/><geom type="sphere" size=".01" pos="0 0 .5"/>
</body></body></worldbody></mujoco>"""


def points_inside(m, geom, rng, count=4000):
    """Points of a geometry in the frame of its body, by rejection, and for a mesh by mixing its vertices."""
    kind, size = mujoco.mjtGeom(m.geom_type[geom]), m.geom_size[geom]
    p = rng.uniform(-1, 1, (count, 3))
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        first = m.mesh_vertadr[m.geom_dataid[geom]]
        vertices = m.mesh_vert[first : first + m.mesh_vertnum[m.geom_dataid[geom]]]
        local = rng.dirichlet(np.full(len(vertices), 0.3), count) @ vertices
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        local = np.where(rng.random((count, 3)) < 0.3, np.sign(p), p) * size
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        p = p[np.hypot(p[:, 0], p[:, 1]) <= 1]
        local = np.c_[p[:, :2] * size[0], np.where(rng.random(len(p)) < 0.3, np.sign(p[:, 2]), p[:, 2]) * size[1]]
    else:
        p = p[np.linalg.norm(p, axis=1) <= 1]
        local = p * (size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else size[0])
        if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            local[:, 2] += rng.uniform(-1, 1, len(p)) * size[1]
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, m.geom_quat[geom])
    return m.geom_pos[geom] + local @ R.reshape(3, 3).T


def depth_in_spheres(p, spheres, frame):
    own = [i for i, name in enumerate(spheres.frames) if name == frame]
    return (np.linalg.norm(p[:, None] - spheres.offsets[own], axis=-1) - spheres.radii[own]).min(axis=1)


@pytest.mark.parametrize("max_error", [0.03, 0.015])
@pytest.mark.parametrize("shape", list(SHAPES))
def test_every_point_is_covered_and_spheres_stick_out_as_far_as_stated_at_most(tmp_path, shape, max_error):
    path = tmp_path / "robot.xml"
    path.write_text(MODEL.format(SHAPES[shape]))
    m = mujoco.MjModel.from_xml_path(str(path))
    spheres = spheres_from_model(path, max_error)
    assert set(spheres.frames) == {"upper", "lower"} and 0 <= spheres.coverage_error <= max_error
    rng = np.random.default_rng(0)
    inside = points_inside(m, 1, rng)
    assert depth_in_spheres(inside, spheres, "upper").max() <= 1e-6
    own = [i for i, name in enumerate(spheres.frames) if name == "upper"]
    direction = rng.normal(size=(300, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    for i in own[:40]:
        rim = spheres.offsets[i] + spheres.radii[i] * direction
        nearest = np.linalg.norm(rim[:, None] - inside, axis=-1).min(axis=1)
        assert nearest.max() <= spheres.coverage_error + 0.025  # the samples inside are that far from one another


def test_the_pandas_spheres_cover_its_geometry():
    spheres = panda_spheres()
    assert 20 <= spheres.size <= 40 and spheres.coverage_error <= 0.015
    m = mujoco.MjModel.from_xml_path(str(PANDA_MODEL))
    rng = np.random.default_rng(0)
    for geom in range(m.ngeom):
        inside = points_inside(m, geom, rng, 500)
        assert depth_in_spheres(inside, spheres, m.body(m.geom_bodyid[geom]).name).max() <= 1e-6


def test_the_pandas_pairs_are_free_at_home_and_are_those_of_its_model():
    spheres, pairs = panda_spheres(), panda_self_pairs()
    home = np.array([0, -0.785398, 0, -2.356194, 0, 1.570796, 0.785398])
    assert SelfDistances(spheres.points(panda()), pairs, spheres.radii)(home).min() > 0.1
    met = {frozenset((spheres.frames[i], spheres.frames[j])) for i, j in pairs}
    base = {"panda_link0", "panda_link1", "panda_link2"}
    assert met and all(len(pair & base) == 1 and not pair & {"panda_link3", "panda_link4"} for pair in met)


def test_pairs_leave_out_own_adjacent_rigidly_joined_and_ignored_links():
    frames = (
        "panda_link0",
        "panda_link1",
        "panda_link2",
        "panda_link7",
        "panda_hand",
        "panda_leftfinger",
        "panda_link0",
    )
    pairs = self_pairs(panda(), frames, {"panda_hand": ["panda_link0"]})
    names = {(frames[i], frames[j]) for i, j in pairs}
    assert all(i < j for i, j in pairs)
    assert ("panda_link0", "panda_link2") in names and ("panda_link0", "panda_link7") in names
    assert ("panda_link0", "panda_link1") not in names  # adjacent
    assert ("panda_link7", "panda_hand") not in names  # rigidly joined, as are the locked fingers
    assert ("panda_hand", "panda_leftfinger") not in names
    assert ("panda_link0", "panda_hand") not in names and ("panda_hand", "panda_link0") not in names  # ignored
    assert ("panda_link0", "panda_link0") not in names
    with pytest.raises(UnknownNameError, match="frame in ignore 'panda_paw'"):
        self_pairs(panda(), frames, {"panda_paw": ["panda_link0"]})
    with pytest.raises(UnknownNameError, match="frame 'panda_paw'"):
        self_pairs(panda(), ("panda_paw",))


def test_contact_exclusions_of_a_model_are_ignored_pairs(tmp_path):
    path = tmp_path / "robot.xml"
    text = MODEL.format(SHAPES["box"])
    path.write_text(text)
    assert ignored_by_model(path).get("upper", ()) == ("world",) * 0
    path.write_text(text.replace("</mujoco>", '<contact><exclude body1="lower" body2="upper"/></contact></mujoco>'))
    assert ignored_by_model(path)["upper"] == ("lower",)
    assert self_pairs(load_robot(path), ("upper", "lower", "world"), ignored_by_model(path)) == ((1, 2),)


def test_what_cannot_be_covered_is_refused(tmp_path):
    path = tmp_path / "robot.xml"
    with pytest.raises(RobotError, match="no such file"):
        spheres_from_model(path)
    path.write_text("<mujoco><worldbody/></mujoco>")
    with pytest.raises(ConfigurationError, match="no geometry to cover"):
        spheres_from_model(path)
    path.write_text("<mujoco")
    with pytest.raises(RobotError, match="cannot be read"):
        spheres_from_model(path)
    path.write_text(MODEL.format(SHAPES["box"]))
    with pytest.raises(ConfigurationError, match="max_error of spheres_from_model is 0.*positive"):
        spheres_from_model(path, 0.0)
    with pytest.raises(ConfigurationError, match="needs more than 4096"):
        spheres_from_model(path, 1e-5)
    with pytest.raises(ConfigurationError, match=r"no geometry for \['hand'\]"):
        spheres_from_model(path, frames=["hand"])
    with pytest.raises(ConfigurationError, match="2 frames with offsets"):
        RobotSpheres(("a", "b"), np.zeros((1, 3)), np.zeros(2))


def test_spheres_of_a_base_can_be_left_out():
    whole = panda_spheres()
    moving = whole.without("panda_link0", "panda_link1")
    assert 0 < moving.size < whole.size
    kept = [i for i, name in enumerate(whole.frames) if name not in ("panda_link0", "panda_link1")]
    assert moving.frames == tuple(whole.frames[i] for i in kept)
    np.testing.assert_array_equal(moving.offsets, np.asarray(whole.offsets)[kept])
    np.testing.assert_array_equal(moving.radii, np.asarray(whole.radii)[kept])
    with pytest.raises(UnknownNameError, match="unknown frame with spheres 'panda_link'.*panda_link0"):
        whole.without("panda_link")
    with pytest.raises(ConfigurationError, match="no sphere is left without those on"):
        whole.without(*set(whole.frames))
