"""A live page whose policy knows of the door what a depth camera sees of it."""

import time
from argparse import Namespace
from functools import partial

import numpy as np
import pytest

from jaxrmp.cli import main
from jaxrmp.kinematics import panda
from jaxrmp.scenes import scene

PLACE = Namespace(camera="depth", camera_at=None, camera_distance=None)


@pytest.fixture(scope="module")
def viewer(door_learning, can_draw):
    pytest.importorskip("viser", reason="needs viser: pip install 'jaxrmp[viewer]'")
    if not can_draw:
        pytest.skip("needs OSMesa or a display")
    from jaxrmp.cli._camera import camera_spheres, scene_camera
    from jaxrmp.viewer import Viewer, skill_content

    skill, prepared = door_learning.skill, door_learning.prepared
    place = scene("door", T_world_object=np.asarray(skill.T_world_object, float))
    spheres = camera_spheres(skill, place)
    content = skill_content(skill, panda(), prepared, scene=place, balls=0)._replace(
        camera=partial(scene_camera, PLACE, place, prepared, spheres), camera_spheres=spheres
    )
    viewer = Viewer(content, 0, skill=skill, prepared=prepared)
    viewer.start()
    yield viewer
    viewer.stop()


def wait(condition, what, timeout=60.0):
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, f"waited {timeout} s for {what}"
        time.sleep(0.02)


def pass_frames(viewer, count):
    number = viewer.loop.frame.number
    wait(lambda: viewer.loop.frame.number > number + count, "the policy to go on")


def told(viewer) -> np.ndarray:
    return np.asarray(viewer.loop.frame.situation.T_world_target, float)[:3, 3]


def test_the_policy_is_told_what_is_seen_and_that_it_is_lost(viewer):
    view, at = viewer.depth, np.array(viewer.target.position, float)
    wait(lambda: not view.sight.lost and view.sight.position < 0.003, "the door to be seen")
    wait(lambda: "seen" in view.text.content and "door_hinge" in view.text.content, "the words")
    measured = viewer.server.scene.get_handle_by_name("/measured")
    wait(lambda: len(measured.points) > 1000, "points")
    assert len(np.unique(measured.colors, axis=0)) == 3  # the door's, the arm's, the floor's
    view.hidden.value = True
    wait(lambda: view.sight.lost, "the door to be lost behind the board")
    pass_frames(viewer, 5)
    before = told(viewer)
    viewer.target.position = at + [0.02, 0.03, 0.0]
    wait(lambda: "lost" in view.text.content, "the words")
    wait(lambda: view.sight.position > 0.03, "an image with the door elsewhere")
    wait(lambda: "by what the camera saw last" in viewer.status.content, "the goal to be told with care")
    np.testing.assert_array_equal(told(viewer), before)
    door = viewer.server.scene.get_handle_by_name("/object")
    np.testing.assert_allclose(door.position, at + [0.02, 0.03, 0.0], atol=1e-6)  # the page shows the truth
    view.hidden.value = False
    wait(lambda: not view.sight.lost and view.sight.position < 0.003, "the door to be found again")
    wait(lambda: np.linalg.norm(told(viewer) - viewer.target.position) < 0.003, "the policy to be told")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["view", "--camera", "depth"], "give SKILL and --scene"),
        (["view", "any.npz", "--camera-distance", "1"], "add --camera depth"),
    ],
)
def test_a_camera_without_a_scene_is_explained(arguments, message, capsys):
    assert main(arguments) == 1
    assert message in capsys.readouterr().err
