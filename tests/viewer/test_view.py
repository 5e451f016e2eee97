"""A learned skill running live in the door's scene, watched and handled by a page in Chromium."""

from dataclasses import replace

import numpy as np
import pytest

from jaxrmp.kinematics import forward_kinematics, panda
from jaxrmp.scenes import scene
from jaxrmp.world import Spheres, World


@pytest.fixture(scope="module")
def viewer(door_learning):
    """The page's session: started once, for compiling is most of the time."""
    pytest.importorskip("viser", reason="needs viser: pip install 'jaxrmp[viewer]'")
    from jaxrmp.viewer import Recording, Viewer, skill_content

    skill, prepared = door_learning.skill, door_learning.prepared
    place = scene("door", T_world_object=np.asarray(skill.T_world_object, float))
    q = np.asarray(prepared.joints.q[0], float)[::-1]  # from the door back to the start
    logged = Recording(np.linspace(0.0, 2.0, len(q)), q, np.zeros((len(q), 3)))
    content = skill_content(skill, panda(), prepared, scene=place, balls=0)
    viewer = Viewer(content, 0, skill=skill, prepared=prepared, replayed=logged)
    viewer.start()
    yield viewer
    viewer.stop()


def points(viewer) -> np.ndarray:
    """The skill's control points [K, 3] in the object's frame, from the poses that the page was sent."""
    frame, skill = viewer.loop.frame, viewer.skill
    T = np.stack([viewer.pose(frame, name) for name in skill.frames])
    p = np.einsum("kij,kj->ki", T[:, :3, :3], np.asarray(skill.offsets)) + T[:, :3, 3]
    T_object = np.asarray(frame.situation.T_world_target, float)
    return (p - T_object[:3, 3]) @ T_object[:3, :3]


def missed(viewer) -> float:
    """How far the control point that is furthest from its target is from it, m."""
    return float(np.linalg.norm(points(viewer) - np.asarray(viewer.skill.targets), axis=1).max())


def hand(viewer) -> np.ndarray:
    return viewer.pose(viewer.loop.frame, viewer.content.hand)[:3, 3].astype(float)


def set_control(page, handle, value) -> None:
    """What the page sends when a slider, a box or a list is set."""
    page.send("GuiUpdateMessage", uuid=handle._impl.uuid, updates={"value": value})


def test_the_page_loads_the_arm_moves_and_follows_the_handle(viewer, page_of, tmp_path):
    page = page_of(viewer)
    begin = np.asarray(forward_kinematics(panda(), viewer.content.q, viewer.content.hand))[:3, 3]
    page.wait(lambda: missed(viewer) < 0.01, "the hand at the handle", 90)
    assert np.linalg.norm(hand(viewer) - begin) > 0.1
    moved = np.array(viewer.content.T_world_target)
    c, s = np.cos(0.15), np.sin(0.15)
    moved[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ moved[:3, :3]
    moved[:3, 3] += [0.05, -0.06, 0.04]
    page.drag("/target", moved)
    page.wait(lambda: missed(viewer) > 0.03, "the page's drag to arrive")
    page.wait(lambda: missed(viewer) < 0.01, "the hand at the moved handle", 90)
    assert np.abs(np.asarray(viewer.loop.frame.situation.T_world_target) - moved).max() < 1e-3
    page.page.get_by_text("at the goal").first.wait_for()
    page.picture(tmp_path / "view.png")
    assert len(page.received) > 20
    assert page.errors == []
    page.drag("/target", np.asarray(viewer.content.T_world_target))


def test_a_push_moves_the_hand_and_the_certificate_stands(viewer, page_of):
    page = page_of(viewer)
    set_control(page, viewer.speed, 2.0)
    page.wait(lambda: missed(viewer) < 0.005, "the hand at the handle", 90)
    before, violations = hand(viewer), viewer.loop.frame.watched.violations
    page.click("Push", lambda: np.linalg.norm(hand(viewer) - before) > 0.01)
    page.wait(lambda: missed(viewer) < 0.005, "the hand to come back to the handle", 60)
    assert viewer.loop.frame.watched.violations == violations
    page.wait(lambda: "certified" in viewer.plots.certificate.content, "the plots")
    assert viewer.plots.certificate.content.startswith("certified")


def test_gains_and_switches_change_the_policy_without_compiling_it_again(viewer, page_of):
    from jaxrmp.viewer._live import advance

    page = page_of(viewer)
    page.wait(advance._cache_size, "the first step", 300)
    compiled = advance._cache_size()
    slider = viewer.gains.slider("learned.speed")
    set_control(page, slider, 0.4)
    page.wait(
        lambda: np.allclose(viewer.loop.frame.situation.policy.tasks[0].learned.speed, 0.4, atol=0.01),
        "the faster policy",
    )
    learned = viewer.switches.boxes[:3]
    for box in learned:
        set_control(page, box, False)
    page.wait(lambda: not np.asarray(viewer.loop.frame.situation.shares)[:3].any(), "the switches")
    moved = np.array(viewer.content.T_world_target)
    moved[2, 3] -= 0.1
    page.drag("/target", moved)
    page.wait(lambda: missed(viewer) > 0.09, "the drag")
    page.page.wait_for_timeout(500)
    assert missed(viewer) > 0.09  # nothing draws the hand there now but the leaf of its orientation
    for box in learned:
        set_control(page, box, True)
    page.wait(lambda: missed(viewer) < 0.01, "the hand at the lower handle", 90)
    page.drag("/target", viewer.content.T_world_target)
    viewer.gains.reset()
    assert advance._cache_size() == compiled


def test_with_every_leaf_off_the_arm_stands_still_and_says_why(viewer, page_of):
    page = page_of(viewer)
    for box in viewer.switches.boxes:
        set_control(page, box, False)
    page.page.get_by_text("not finite").first.wait_for()
    assert np.isfinite(viewer.loop.frame.q).all()
    assert not viewer.loop.playing
    for box in viewer.switches.boxes:
        set_control(page, box, True)
    page.click("Play", lambda: viewer.loop.playing)
    page.click("Pause", lambda: not viewer.loop.playing)
    number = viewer.loop.frame.number
    page.wait(lambda: viewer.loop.frame.number > number + 1, "the steps that were under way")
    time = viewer.loop.frame.time
    start = np.asarray(viewer.content.q, float)
    page.click("Reset", lambda: np.abs(viewer.loop.frame.q - start).max() < 1e-5)
    assert viewer.loop.frame.time == time
    page.click("Play", lambda: viewer.loop.playing)


def test_spheres_and_lines_are_shown_on_demand(viewer, page_of):
    page = page_of(viewer)
    spheres = viewer.server.scene.get_handle_by_name("/arm/panda_hand/spheres")
    assert not spheres.visible
    set_control(page, viewer.shown["collision spheres"], True)
    page.wait(lambda: spheres.visible, "the spheres")
    triangles = viewer.server.scene.get_handle_by_name("/lines/demonstrations/triangles")
    set_control(page, viewer.shown["triangles"], True)
    page.wait(lambda: triangles.visible, "the triangles")
    set_control(page, viewer.shown["collision spheres"], False)


def test_reproductions_are_rolled_out_when_they_are_asked_for(viewer, page_of):
    page = page_of(viewer)
    assert "reproductions" not in viewer._lines
    set_control(page, viewer.shown["reproductions"], True)
    page.page.get_by_text("mean DTW").first.wait_for(timeout=90_000)
    assert viewer.server.scene.get_handle_by_name("/lines/reproductions") is not None
    set_control(page, viewer.shown["reproductions"], False)


def test_the_session_outlives_its_page_and_can_be_told_to_end_with_it(viewer, page_of):
    page = page_of(viewer)
    page.wait(lambda: len(viewer.server.get_clients()) == 1, "one page")
    page.close()
    viewer.wait(until_closed=True)
    assert viewer.loop.failure is None


def test_distances_to_the_furniture_and_of_the_arm_to_itself_are_plotted(viewer, page_of):
    assert viewer._distances == ("to itself", "to furniture")

    def measured() -> bool:
        rows = list(viewer.plots._distances._rows)
        return bool(rows) and 0 < rows[-1][1] < 30 and 0 < rows[-1][2] < 30  # cm

    page_of(viewer).wait(measured, "distances that are measured")


def test_a_log_is_played_and_then_the_policy_takes_over(viewer, page_of):
    page, log = page_of(viewer), viewer.replayed
    page.wait(lambda: not viewer.loop.replaying and missed(viewer) < 0.01, "the hand at the handle", 90)
    seen = []

    def played():
        seen.append(viewer.loop.frame.q.copy())
        return not viewer.loop.replaying

    page.click("Replay", lambda: viewer.loop.replaying)
    page.wait(played, "the end of what was recorded", 60)
    off = [np.abs(log.q - q).max(axis=1).min() for q in seen]
    inside = [k for k, o in enumerate(off) if o < 0.05]  # before it begins and once it is over the arm is elsewhere
    assert len(inside) > 3 and max(off[inside[0] : inside[-1]]) < 0.05 and np.ptp(np.stack(seen), axis=0).max() > 0.3
    page.wait(lambda: missed(viewer) < 0.01, "the policy to bring the hand back", 90)


def test_a_skill_without_its_demonstrations_can_still_be_shown(viewer):
    from jaxrmp.viewer import skill_content

    content = skill_content(replace(viewer.skill), panda(), None, balls=1)
    around = World(spheres=Spheres.of([(content.balls[0], 0.1)]))
    names = [leaf.name for leaf in content.policy.tree(content.T_world_target, around).leaves()]
    assert names[-1] == "collision_avoidance" and viewer.switches.names[3:5] == ("joint_damping", "joint_limit")
    assert len(content.hints) == 3 and content.hints[0].startswith("learned: ")  # beside learned[0], learned[1], ...
