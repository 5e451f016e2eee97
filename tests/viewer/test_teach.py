"""Teaching in the browser, by a page in Chromium: what is dragged is recorded, learned and reproduced."""

import json

import numpy as np
import pytest

from jaxrmp.cli import main
from jaxrmp.learning import load_demonstrations, load_skill

FAST = [
    "--method",
    "paper",
    "--metric.updates",
    "200",
    "--potential.widths",
    "[0.05]",
    "--potential.basin_starts",
    "200",
]
BY_JOINTS = "joint sliders"
SPEED = 4.0  # of the page's own slider: what is recorded has simulated time
AWAY = np.array(
    [[0.0, 0.25, 0.1], [0.05, 0.3, 0.0], [-0.05, 0.2, 0.15], [0.05, 0.2, 0.05], [0.0, 0.3, 0.12], [0.1, 0.25, 0.15]]
)
PLACE = [
    [0.02, 0.03, 0.0],
    [-0.02, 0.0, 0.01],
    [0.0, -0.03, 0.0],
    [0.03, 0.0, 0.0],
    [0.0, 0.02, 0.02],
    [-0.02, -0.02, 0.0],
]


@pytest.fixture(scope="module")
def teacher(tmp_path_factory):
    viewer = pytest.importorskip("jaxrmp.viewer")
    pytest.importorskip("viser", reason="needs viser: pip install 'jaxrmp[viewer]'")
    content = viewer.reach_content(balls=0, self_collision=False)
    teacher = viewer.Teacher(content, tmp_path_factory.mktemp("taught") / "cup", port=0)
    teacher.start()
    yield teacher
    teacher.stop()


def hand_of(teacher) -> np.ndarray:
    return teacher.pose(teacher.loop.frame, teacher.content.hand)


def bring(page, teacher, T) -> None:
    """Drag the hand's gizmo somewhere and wait until the hand is there, and still."""
    page.drag("/target", T)

    def there() -> bool:
        still = np.abs(teacher.loop.frame.qd).max() < 0.02
        return still and np.linalg.norm(hand_of(teacher)[:3, 3] - T[:3, 3]) < 2e-3

    page.wait(there, f"the hand at {T[:3, 3]}")


def curve(start: np.ndarray, end: np.ndarray, samples: int = 9) -> list[np.ndarray]:
    """Poses from a start in an arc that comes down on the end, turned on the way as the end is."""
    s = (np.linspace(0, 1, samples) ** 2 * (3 - 2 * np.linspace(0, 1, samples)))[:, None]
    above = end[:3, 3] + [0.0, 0.0, 0.15]
    points = (1 - s) ** 2 * start[:3, 3] + 2 * s * (1 - s) * above + s**2 * end[:3, 3]
    poses = np.tile(end, (samples, 1, 1))
    poses[:, :3, 3] = points
    return list(poses)


def test_what_is_taught_in_the_browser_is_learned_and_reproduced(teacher, page_of, tmp_path, monkeypatch):
    page = page_of(teacher)
    page.send("GuiUpdateMessage", uuid=teacher.speed._impl.uuid, updates={"value": SPEED})
    home = teacher.content.T_world_target
    page.click("Record", lambda: teacher.recorder.recording)
    page.click("Stop", lambda: not teacher.recorder.recording)
    page.page.get_by_text("is not kept").first.wait_for()
    for away, place in zip(AWAY, PLACE, strict=True):
        start, end = home.copy(), home.copy()
        start[:3, 3] += away
        end[:3, 3] += [0.15, -0.2, -0.25] + np.array(place)
        bring(page, teacher, end)
        at = end[:3, 3]
        page.click("Mark target at the hand", lambda at=at: np.linalg.norm(teacher.target_frame.position - at) < 5e-3)
        bring(page, teacher, start)
        before = len(teacher.recorder.recordings)
        page.click("Record", lambda: teacher.recorder.recording)
        page.play("/target", curve(start, end))
        bring(page, teacher, end)
        page.click("Stop", lambda n=before: len(teacher.recorder.recordings) == n + 1)
    assert [np.linalg.norm(r.hand[-1] - r.T_world_target[:3, 3]) < 5e-3 for r in teacher.recorder.recordings] == [
        True
    ] * 6

    page.click("Record", lambda: teacher.recorder.recording)
    bring(page, teacher, home)
    page.click("Stop", lambda: len(teacher.recorder.recordings) == 7)
    page.page.get_by_text("Demonstration 7:").wait_for()
    page.click("Discard", lambda: len(teacher.recorder.recordings) == 6)
    page.page.get_by_text("6 are left").wait_for()

    last = teacher.recorder.recordings[-1]
    page.click("Replay", lambda: np.linalg.norm(hand_of(teacher)[:3, 3] - last.hand[0]) < 0.03)
    page.wait(lambda: not teacher.loop.replaying, "the replay to end")
    assert np.linalg.norm(hand_of(teacher)[:3, 3] - last.hand[-1]) < 0.01

    page.wait(lambda: np.abs(teacher.loop.frame.qd).max() < 0.01, "the arm to stand still")
    stood = teacher.loop.frame.q.copy()
    page.send("GuiUpdateMessage", uuid=teacher.mode._impl.uuid, updates={"value": BY_JOINTS})
    page.wait(lambda: teacher._sliders[-1].visible, "the joint sliders")
    wanted = np.array([slider.value for slider in teacher._sliders])
    np.testing.assert_allclose(wanted, stood, atol=0.05)
    wanted[0] += 0.3
    page.send("GuiUpdateMessage", uuid=teacher._sliders[0]._impl.uuid, updates={"value": float(wanted[0])})
    page.wait(lambda: np.abs(teacher.loop.frame.q - wanted).max() < 0.02, "the joints at their sliders")

    page.click("Save", lambda: "Saved 6" in teacher.told.content)
    page.page.get_by_text("Saved 6 demonstrations").wait_for()
    page.picture(tmp_path / "teach.png")
    assert page.errors == []

    page.close()
    teacher.set_playing(False)

    found = load_demonstrations(teacher.out)
    assert (len(found), found.robot, found.object_names) == (6, "panda", ("target",))
    monkeypatch.chdir(tmp_path)
    configuration = str(teacher.out) + ".toml"
    assert main(["learn", configuration, "--demos", str(teacher.out), "--out", "learned", *FAST]) == 0
    report = json.loads((tmp_path / "learned" / "learning_report.json").read_text())
    assert report["reproduction"]["mean"]["dtw_cm"] <= 1.5
    assert report["reproduction"]["mean"]["goal_cm"] <= 1.0
    assert load_skill(tmp_path / "learned" / "cup.skill.npz").configuration.object == "target"
