"""Covers hold every point, stick out as far as they say, take few spheres, and are told where there is none."""

import warnings
from pathlib import Path
from types import SimpleNamespace

import jax
import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from jaxrmp import ConfigurationError, FileWarning, NoGeometryError, RobotError, UnsafeFileWarning, policies
from jaxrmp.kinematics import load_robot, load_robot_from_string, panda
from jaxrmp.world import (
    RobotSpheres,
    SelfDistances,
    _robot_spheres,
    own_self_pairs,
    own_spheres,
    panda_self_pairs,
    panda_spheres,
    self_pairs,
    spheres_from_model,
    without_never_near,
)

HINGE = '<joint name="{}" axis="0 0 1" range="-1 1" limited="true"/>'


def pill(length=0.75, radius=0.08, around=40, along=20):
    """Vertices of a smooth mesh: 800, of the size of a large arm's upper arm."""
    polar, turn = np.linspace(0.15, np.pi - 0.15, along), np.linspace(0, 2 * np.pi, around, endpoint=False)
    z = radius * np.cos(polar) + np.sign(np.cos(polar)) * (length / 2 - radius)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return np.concatenate([np.c_[radius * np.sin(b) * ring, np.full(around, h)] for b, h in zip(polar, z, strict=True)])


def of_vertices(*meshes):
    """A model of one body with these hulls, each given by its vertices."""
    assets = "".join(
        f'<mesh name="m{k}" vertex="{" ".join(map(str, np.round(v, 6).ravel()))}"/>' for k, v in enumerate(meshes)
    )
    geoms = "".join(f'<geom type="mesh" mesh="m{k}"/>' for k in range(len(meshes)))
    body = f'<body name="link">{HINGE.format("j")}{geoms}</body>'
    return mujoco.MjModel.from_xml_string(f"<mujoco><asset>{assets}</asset><worldbody>{body}</worldbody></mujoco>")


def hulls(m):
    for g in range(m.ngeom):
        turn, at = np.zeros(9), m.geom_dataid[g]
        mujoco.mju_quat2Mat(turn, m.geom_quat[g])
        points = m.mesh_vert[m.mesh_vertadr[at] :][: m.mesh_vertnum[at]]
        yield m.geom_pos[g] + points @ turn.reshape(3, 3).T


def assert_covers(spheres, solids):
    """By samples of surface and inside, and by the exact depth of the centres in the hulls."""
    rng, offsets, radii = np.random.default_rng(0), np.asarray(spheres.offsets), np.asarray(spheres.radii)
    deepest = np.full(len(radii), -np.inf)
    for points in solids:
        hull = ConvexHull(points)
        corners = (
            rng.dirichlet(np.ones(3), 20000)[..., None]
            * points[hull.simplices[rng.integers(len(hull.simplices), size=20000)]]
        )
        surface = corners.sum(axis=1)
        inside = points.mean(axis=0) + rng.random((20000, 1)) * (surface - points.mean(axis=0))
        samples = np.concatenate([points, surface, inside])
        gap = (np.linalg.norm(samples[:, None] - offsets, axis=-1) - radii).min(axis=1)
        assert gap.max() <= 1e-6
        deepest = np.maximum(deepest, (-hull.equations[:, 3] - offsets @ hull.equations[:, :3].T).min(axis=1))
    assert (radii - deepest).max() <= spheres.coverage_error + 1e-6
    assert (radii - deepest).max() >= 0.9 * spheres.coverage_error
    assert (deepest >= -1e-6).all()


@pytest.mark.parametrize(("max_error", "most"), [(0.03, 6), (0.01, 15)])
def test_a_smooth_mesh_takes_few_spheres(max_error, most):
    m = of_vertices(pill())
    spheres = spheres_from_model(m, max_error)
    assert spheres.size <= most and spheres.coverage_error <= max_error
    assert_covers(spheres, hulls(m))


def test_random_hulls_of_many_and_of_few_points_that_overlap_are_covered():
    rng = np.random.default_rng(1)
    stretched = rng.normal(size=(6000, 3)) * [0.01, 0.02, 0.05]
    m = of_vertices(stretched, rng.uniform(-0.1, 0.1, (9, 3)) + [0, 0, 0.2], rng.uniform(-0.02, 0.02, (30, 3)))
    spheres = spheres_from_model(m, 0.02)
    assert spheres.size < 60 and spheres.coverage_error <= 0.02
    assert_covers(spheres, hulls(m))


def test_links_of_one_mesh_or_of_its_mirror_image_are_covered_by_one_search(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXRMP_CACHE", str(tmp_path))
    points = np.random.default_rng(2).uniform(0, 1, (40, 3)) * [0.1, 0.15, 0.3]
    shapes = points, points * [1, -1, 1], points * [1, 1, 1.2]
    searches = []
    search = _robot_spheres.cover_polytopes
    monkeypatch.setattr(_robot_spheres, "cover_polytopes", lambda *a: searches.append(a) or search(*a))
    assets = "".join(
        f'<mesh name="m{k}" vertex="{" ".join(map(str, np.round(v, 6).ravel()))}"/>' for k, v in enumerate(shapes)
    )
    links = "".join(
        f'<body name="l{k}">{HINGE.format(f"j{k}")}<geom type="mesh" mesh="m{mesh}"/></body>'
        for k, mesh in enumerate((0, 0, 1, 2))
    )
    m = mujoco.MjModel.from_xml_string(f"<mujoco><asset>{assets}</asset><worldbody>{links}</worldbody></mujoco>")
    spheres = spheres_from_model(m, 0.02)
    assert len(searches) == 2  # the last is another shape
    for k, solid in enumerate(hulls(m)):
        own = spheres.rows([i for i, name in enumerate(spheres.frames) if name == f"l{k}"])
        rim = (np.linalg.norm(solid[:, None] - own.offsets, axis=-1) - own.radii).min(axis=1)
        assert own.size and rim.max() <= 1e-6
        shell = ConvexHull(solid)
        deep = (-shell.equations[:, 3] - own.offsets @ shell.equations[:, :3].T).min(axis=1)
        assert (own.radii - deep).max() <= spheres.coverage_error + 1e-6 <= 0.02 + 1e-6


def test_a_body_of_many_spheres_is_covered():
    points = np.random.default_rng(3).normal(size=(200, 3))
    m = of_vertices(0.25 * points / np.linalg.norm(points, axis=1)[:, None] * [2, 1, 0.5])
    spheres = spheres_from_model(m, 0.015)
    assert 64 < spheres.size < 120
    assert_covers(spheres, hulls(m))


def test_links_that_no_joint_moves_take_up_no_spheres_of_those_that_move(tmp_path):
    path = tmp_path / "robot.xml"
    base = '<body name="base" pos="0 0 -1"><geom type="box" size="1 1 .5"/></body>'
    path.write_text(LINKS.replace("<worldbody>", f"<worldbody>{base}"))
    spheres = own_spheres(load_robot(path))
    of_base = [i for i, name in enumerate(spheres.frames) if name == "base"]
    assert len(of_base) > 100 and 0.03 < spheres.coverage_error <= 0.06
    moved = spheres.without("base")
    alone = spheres_from_model(path, 0.015, frames=("arm", "gripper", "camera"))
    np.testing.assert_array_equal(moved.radii, alone.radii)


def test_a_plate_without_thickness_is_covered():
    from jaxrmp.world._cover import cover_polytopes
    from jaxrmp.world._polytopes import hull

    plate = np.random.default_rng(0).uniform(-0.1, 0.1, (60, 3)) * [1, 1, 0]
    centers, radii, error = cover_polytopes([hull(plate, 1e-4)], 0.03)
    assert error <= 0.03
    assert ((np.linalg.norm(plate[:, None] - centers, axis=-1) - radii).min(axis=1) <= 1e-6).all()


def test_no_cell_is_taken_for_empty_because_a_solver_fails(monkeypatch):
    from jaxrmp.world import _polytopes

    with monkeypatch.context() as held:
        held.setattr("scipy.optimize.linprog", lambda *_, **__: SimpleNamespace(status=4, x=None))
        with pytest.raises(ConfigurationError, match="too flat or too small"):
            _polytopes.inner_ball(np.concatenate([np.eye(3), -np.eye(3)]), np.ones(6))


LINKS = f"""<mujoco><worldbody>
<body name="bare">{HINGE.format("a")}<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<body name="arm" pos=".3 0 0">{HINGE.format("b")}<geom type="box" size=".05 .05 .05"/>
  <geom type="sphere" size=".3" contype="0" conaffinity="0"/>
<body name="gripper" pos=".3 0 0">{HINGE.format("c")}<geom type="box" size=".05 .15 .05" contype="0" conaffinity="0"/>
  <body name="camera" pos="0 .16 0"><geom type="box" size=".01 .01 .01"/></body>
</body></body></body></worldbody></mujoco>"""


def test_a_link_that_does_not_collide_is_covered_by_its_look(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(LINKS)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        whole = spheres_from_model(path, 0.03)
    assert set(whole.frames) <= {"arm", "gripper", "camera"} and {"arm", "gripper"} <= set(whole.frames)
    arm = [k for k, name in enumerate(whole.frames) if name == "arm"]
    assert np.asarray(whole.radii)[arm].max() < 0.15  # not by its look, the sphere
    assert set(spheres_from_model(path, 0.03, frames=("gripper",)).frames) == {"gripper"}
    assert set(spheres_from_model(path, 0.03, frames=("camera",)).frames) == {"camera"}
    x, y, z = np.meshgrid(*[np.linspace(-1, 1, 21)] * 3)
    box = np.stack([x, y, z], axis=-1).reshape(-1, 3) * [0.05, 0.15, 0.05]
    shift = {"arm": np.full(3, 9.0), "gripper": np.zeros(3), "camera": np.array([0, 0.16, 0])}
    centers = np.asarray(whole.offsets) + np.array([shift[name] for name in whole.frames])
    gap = (np.linalg.norm(box[:, None] - centers, axis=-1) - np.asarray(whole.radii)).min(axis=1)
    assert gap.max() <= 1e-6


def test_spheres_are_kept_on_disk_by_what_they_were_found_from(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXRMP_CACHE", str(tmp_path))
    first = spheres_from_model(of_vertices(pill()), 0.03)
    (kept,) = (tmp_path / "spheres").iterdir()

    def search(*_):
        raise AssertionError("searched")

    with monkeypatch.context() as held:
        held.setattr(_robot_spheres, "cover_polytopes", search)
        again = spheres_from_model(of_vertices(pill()), 0.03)
        np.testing.assert_array_equal(again.offsets, first.offsets)
        assert again.frames == first.frames and again.coverage_error == first.coverage_error
        for other in (of_vertices(pill(radius=0.081)), of_vertices(pill(), pill(0.3))):
            with pytest.raises(AssertionError, match="searched"):
                spheres_from_model(other, 0.03)
        with pytest.raises(AssertionError, match="searched"):
            spheres_from_model(of_vertices(pill()), 0.02)
    for left in (100, 0):  # bytes of a file that was not written to its end
        kept.write_bytes(kept.read_bytes()[:left])
        assert spheres_from_model(of_vertices(pill()), 0.03).size == first.size
    monkeypatch.setenv("JAXRMP_CACHE", str(kept))  # no folder: nothing can be kept there
    assert spheres_from_model(of_vertices(pill()), 0.03).size == first.size


def test_a_robot_is_covered_as_finely_as_few_spheres_allow_and_an_error_is_never_swallowed(tmp_path, monkeypatch):
    path = tmp_path / "robot.xml"
    path.write_text(LINKS.replace(".05 .15 .05", ".3 .3 .3"))
    robot = load_robot(path)
    found = own_spheres(robot)
    assert found.size <= 100 and 0.03 < found.coverage_error <= 0.06
    monkeypatch.setattr("jaxrmp.world._own_spheres._FINENESS", (1e-5,) * 4)
    with pytest.raises(ConfigurationError, match="max_error=1e-05 m needs more than"):
        policies.reaching_policy(robot, "gripper")
    path.write_text(LINKS.replace('type="box" size=".01 .01 .01"', 'type="mesh" mesh="gone"'))
    with pytest.raises(RobotError, match="gone"):
        policies.reaching_policy(load_robot(path), "gripper")


def test_a_robot_without_any_geometry_is_told_as_unsafe(tmp_path):
    text = f'<mujoco model="stick"><worldbody><body name="link">{HINGE.format("j")}'
    text += '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody></mujoco>'
    path = tmp_path / "robot.xml"
    path.write_text(text)
    for robot, why in ((load_robot(path), "no geometry to cover"), (load_robot_from_string(text), "read from no file")):
        with pytest.warns(UnsafeFileWarning, match=f"'stick' avoids neither obstacles nor itself.*{why}"):
            assert policies.reaching_policy(robot, "link").spheres is None
        with pytest.raises(NoGeometryError, match=why):
            own_spheres(robot)


def test_pairs_that_always_touch_are_left_out(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(LINKS)
    robot = load_robot(path)
    frames, offsets = ("bare", "bare", "gripper"), np.array([[0.3, 0, 0], [0.3, 0, 0], [0, 0, 0]])
    assert own_self_pairs(robot, RobotSpheres(frames, offsets, np.array([0.1, 0.25, 0.1]))) == ((0, 2),)
    assert own_self_pairs(robot, RobotSpheres((), np.zeros((0, 3)), np.zeros(0))) == ()


def test_a_robot_is_covered_by_as_many_spheres_as_are_wanted(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(LINKS)
    robot = load_robot(path)
    covers = [own_spheres(robot, count=count) for count in (12, 40)]
    assert all(cover.size <= count for cover, count in zip(covers, (12, 40), strict=True))
    errors = [cover.coverage_error for cover in covers]
    assert errors == sorted(errors, reverse=True) and errors[0] > errors[-1] > 0
    with pytest.raises(ConfigurationError, match=r"count=1 spheres cannot cover"):
        own_spheres(robot, count=1)


def test_more_pairs_than_a_policy_can_have_are_told_and_not_made(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(LINKS)
    frames = ("bare",) * 300 + ("gripper",) * 300
    with pytest.raises(ConfigurationError, match=r"make 90000 pairs.*count=40"):
        self_pairs(load_robot(path), frames)


def test_pairs_that_are_left_out_as_never_near_are_not():
    robot, spheres = panda(), panda_spheres()
    pairs = panda_self_pairs()
    kept = without_never_near(robot, spheres, pairs)
    assert 0 < len(kept) < len(pairs)
    left = np.array(sorted(set(pairs) - set(kept)))
    q = np.random.default_rng(99).uniform(robot.lower, robot.upper, (4000, 7))
    gaps = jax.jit(jax.vmap(SelfDistances(spheres.points(robot), left.tolist(), spheres.radii)))(q.astype(np.float32))
    assert gaps.min() > 0.06  # beyond where self avoidance is felt
    always = SelfDistances(spheres.points(robot), kept, spheres.radii)
    assert jax.jit(jax.vmap(always))(q.astype(np.float32)).min(0).max() < 0.2
    with pytest.raises(ConfigurationError, match="within is nan"):
        without_never_near(robot, spheres, pairs, within=float("nan"))


def test_advice_on_a_cover_names_the_file_that_was_given_and_ends(tmp_path):
    model, file = Path(__file__).parents[1] / "kinematics" / "models" / "six_axis.urdf", tmp_path / "own.toml"
    said = []
    for line in ("", "cover_error = 0.03\n"):
        file.write_text(f'file = "{model.as_posix()}"\n{line}')
        robot = load_robot(file)
        with pytest.warns(FileWarning, match="touch too often") as told:
            own_self_pairs(robot, own_spheres(robot))
        said.append(str(told[0].message))
    assert f"`cover_error = 0.015` in {file}. Or" in said[0] and "six_axis.toml" not in said[0]
    assert "cover_error" not in said[1] and f'say so: `ignore.base = ["upper_arm"]` in {file}.' in said[1]
    with pytest.raises(ConfigurationError, match=f"a larger cover_error in {file} than 0.03"):
        self_pairs(robot, ["base", "tool"] * 150)
    with pytest.raises(ConfigurationError, match=r"Have fewer spheres: world.own_spheres\("):
        self_pairs(load_robot(model), ["base", "tool"] * 150)
