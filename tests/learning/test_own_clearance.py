"""Whether the robot is clear of itself in demonstrated postures: another branch, or words about it."""

import warnings

import numpy as np
import pytest

from jaxrmp import FileWarning
from jaxrmp._rotations import quaternion_of_rotation
from jaxrmp.cli import main
from jaxrmp.kinematics import load_robot, load_robot_from_string
from jaxrmp.learning import on_robot, own_clearance

from .folding_arm import ARM, FOLDED, OPEN, folding_arm, poses_of_hand

UP = ARM.replace('axis="0 -1 0" range="-3 3"/>\n        <geom', 'axis="0 -1 0" range="-1 3"/>\n        <geom')
UP = UP.replace('name="elbow" axis="0 -1 0" range="-3 3"', 'name="elbow" axis="0 -1 0" range="-3 0"')


def ways(demonstrations):
    return [d.q for d in demonstrations]


def test_the_posture_is_taken_in_which_the_arm_is_clear_of_itself(tmp_path):
    robot = load_robot(folding_arm(tmp_path))
    poses = poses_of_hand(robot, FOLDED)
    with pytest.warns(FileWarning) as told:
        found = on_robot(poses, robot, "hand", FOLDED)
    said = [str(warning.message) for warning in told]
    assert any(
        "at the start posture itself (poses.start) spheres on fore and hand overlap by 5.8 cm" in s for s in said
    )
    assert any("bent otherwise to follow the hand, clear of itself by 7.5 cm, from [0.1, -0.4," in s for s in said)
    np.testing.assert_allclose(found[0].q[0], OPEN, atol=1e-4)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        clear = on_robot(poses, robot, "hand", OPEN)
        assert own_clearance(robot, ways(found)).distance > 0.05
    np.testing.assert_allclose(np.stack(ways(found)), np.stack(ways(clear)), atol=1e-3)


def test_where_no_posture_is_clear_it_is_said_which_links_where_and_what_to_do(tmp_path):
    robot = load_robot(folding_arm(tmp_path, UP))
    with pytest.warns(FileWarning, match="at the start posture itself"):
        found = on_robot(poses_of_hand(robot, FOLDED), robot, "hand", FOLDED)
    np.testing.assert_allclose(found[0].q[0], FOLDED, atol=1e-3)
    with pytest.warns(FileWarning) as told:
        clearance = own_clearance(robot, ways(found), of_poses=True)
    (said,) = [str(warning.message) for warning in told]
    assert f"spheres on fore and hand overlap by {-100 * clearance.distance:.1f} cm in demonstration 0" in said
    assert "(poses.start)" in said and "`cover_error = 0.0074` in a robot file, folding.toml" in said
    assert '`ignore.fore = ["hand"]` there' in said
    with pytest.warns(FileWarning, match="Demonstrate with the arm clear of itself"):
        own_clearance(robot, ways(found))


def test_the_advice_works_as_it_is_written(tmp_path):
    """A robot file with the lines that are told, by the name that they are told with."""
    folding_arm(tmp_path, UP)
    (tmp_path / "folding.toml").write_text('file = "folding.xml"\nignore.fore = ["hand"]\n')
    assert own_clearance(load_robot(tmp_path / "folding.toml"), [FOLDED[None]]).distance > 0
    (tmp_path / "folding.toml").write_text('file = "folding.xml"\ncover_error = 0.0074\n')
    with pytest.warns(FileWarning, match=r"overlap by .* `cover_error = 0.00\d+`"):
        finer = own_clearance(load_robot(tmp_path / "folding.toml"), [FOLDED[None]])
    with pytest.warns(FileWarning, match="overlap by 5.8 cm"):
        coarse = own_clearance(load_robot(tmp_path / "folding.xml"), [FOLDED[None]])
    assert coarse.distance < finer.distance < 0


def test_the_closest_is_found_by_demonstration_and_sample(tmp_path):
    robot = load_robot(folding_arm(tmp_path))
    paths = [np.tile(OPEN, (40, 1)), np.tile(OPEN, (30, 1)), np.tile(OPEN, (20, 1))]
    paths[1][12] = FOLDED
    with pytest.warns(FileWarning, match="in demonstration 1 at sample 12"):
        found = own_clearance(robot, paths)
    assert (found.demonstration, found.sample, set(found.frames)) == (1, 12, {"fore", "hand"})


def test_a_robot_whose_meshes_are_missing_is_told_and_one_without_any_is_in_the_result(tmp_path):
    link = "<link name='{}'>{}</link>"
    mesh = "<collision><geometry><mesh filename='package://far/arm.stl'/></geometry></collision>"
    joint = (
        "<joint name='j' type='revolute'><parent link='a'/><child link='b'/>"
        "<limit lower='-1' upper='1' velocity='1' effort='1'/></joint>"
    )
    urdf = f"<robot name='far'>{link.format('a', mesh)}{link.format('b', mesh)}{joint}</robot>"
    (tmp_path / "far.urdf").write_text(urdf)
    with pytest.warns(FileWarning) as told:
        found = own_clearance(load_robot(tmp_path / "far.urdf"), [np.zeros((2, 1))])
    (said,) = [str(warning.message) for warning in told]
    assert '`packages.far = "FOLDER"` in a robot file, far.toml' in said and "will fail" in said
    assert np.isnan(found.distance) and "arm.stl" in found.why
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert "no file" in str(own_clearance(load_robot_from_string(ARM), [OPEN[None]]))


def test_check_looks_at_it(tmp_path, capsys):
    robot = load_robot(folding_arm(tmp_path, UP))
    poses = poses_of_hand(robot, FOLDED)
    arrays = {f"positions_{k}": d.position for k, d in enumerate(poses)}
    arrays |= {f"quaternions_{k}": quaternion_of_rotation(d.hand[:, :3, :3]) for k, d in enumerate(poses)}
    np.savez(tmp_path / "fold.npz", **arrays)
    (tmp_path / "fold.toml").write_text(
        f'name = "fold"\nrobot = "folding.xml"\nposes.start = {FOLDED.tolist()}\n'
        'recording = { units = "m", quaternion = "wxyz", rate = 20 }\n'
        '[[subtasks]]\nname = "hand"\nframe = "hand"\nkind = "pose"\n'
    )
    assert main(["check", str(tmp_path / "fold.toml"), "--demos", str(tmp_path / "fold.npz")]) == 0
    said = capsys.readouterr().out
    assert "the robot and itself: spheres on fore and hand overlap by" in said
    assert said.count("NOTE: 'folding': in the demonstrated postures spheres on fore and hand overlap") == 1
