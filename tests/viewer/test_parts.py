"""What pages are made of, without a browser: pace, switches, energy, recordings, gains, shapes, errors."""

import socket
import sys
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial

from jaxrmp import Batched, Identity, batched, certificate, pullback
from jaxrmp._errors import ConfigurationError, DemonstrationError, MissingDependencyError
from jaxrmp._palette import SERIES
from jaxrmp.cli import main
from jaxrmp.inspection import inspect
from jaxrmp.kinematics import panda
from jaxrmp.learning import load_demonstrations
from jaxrmp.leaves import Attractor, Damping, Posture
from jaxrmp.simulation import Motion
from jaxrmp.viewer._claims import avoidance_words, banners, energy_words
from jaxrmp.viewer._gain_file import place_for_gains, save_gains, with_gains_of
from jaxrmp.viewer._goal import Resting, goal_words
from jaxrmp.viewer._inputs import gain_value, gains_of, with_gain
from jaxrmp.viewer._live import Reading, Situation, examine
from jaxrmp.viewer._loop import LiveLoop
from jaxrmp.viewer._plots import round_end, stroke
from jaxrmp.viewer._push import Push
from jaxrmp.viewer._real_time import Rates, RealTime
from jaxrmp.viewer._recorder import TARGET, Recorder
from jaxrmp.viewer._server import open_server
from jaxrmp.viewer._switched import switched, switches
from jaxrmp.viewer._taught_configuration import write_configuration
from jaxrmp.viewer._watch import EnergyWatch


def tree():
    goals = batched(Attractor(jnp.ones(2), gain=3.0), Attractor(-jnp.ones(2), gain=2.0))
    return pullback(Partial(lambda q: jnp.stack([q, 2 * q])), goals) + Posture(jnp.ones(2)) + Damping(1.0, 2.0)


Q, QD = jnp.array([0.3, -0.2]), jnp.array([0.5, 0.1])


def test_switches_are_named_as_the_inspector_names_leaves():
    assert switches(tree()) == ("attractor[0]", "attractor[1]", "posture", "damping")
    shared = pullback(Partial(lambda q: jnp.stack([q, q])), Batched(Attractor(jnp.ones(2)), shared=True)) + Damping()
    assert switches(shared) == ("attractor", "damping")
    assert jax.eval_shape(inspect, switched(shared, jnp.ones(2)), Q, QD).names == (
        "attractor[0]",
        "attractor[1]",
        "damping",
    )


def test_switched_leaves_add_up_to_the_tree_and_keep_its_certificate():
    shares = jnp.array([1.0, 0.0, 0.5, 1.0])
    with jax.enable_x64(True):
        part = switched(tree(), shares)
        rows, after = (jax.jit(inspect)(node, Q, QD) for node in (tree(), part))
        form = jax.jit(lambda node: node(Q, QD))(part)
        np.testing.assert_allclose(form.f, shares @ rows.f, rtol=1e-6)
        np.testing.assert_allclose(form.M, jnp.einsum("r,rij->ij", shares, rows.M), rtol=1e-6)
        np.testing.assert_allclose(part.energy(Q, QD), shares @ rows.energy, rtol=1e-6)
        found = jax.jit(certificate)(part, Q, QD)
        assert found.residual < 1e-6 and found.voided_by == ()
        np.testing.assert_allclose(after.gap, rows.gap)


def test_a_push_is_a_spring_whose_energy_counts():
    push = Push(jnp.array([0.0, 0.0, 1.0]), 4.0, 3.0)
    x, xd = jnp.zeros(3), jnp.array([1.0, 0.0, 0.0])
    assert push(x, xd).f.tolist() == [-3.0, 0.0, 4.0]
    assert not push(x, xd).M.any()
    assert float(push.energy(x, xd)) == 2.0
    found = certificate(pullback(Identity(), push) + Damping(1.0, 1.0), x, xd)
    assert found.residual < 1e-6


def test_the_clock_asks_for_as_many_steps_as_time_has_passed():
    clock = RealTime(0.001, now=0.0)
    taken = [clock.due(t, 1.0) for t in np.arange(1, 121) / 60]
    assert sum(taken) == 2000 and set(taken) == {16, 17}
    rates = clock.rates()
    assert rates.steps == pytest.approx(1000, rel=0.02) and rates.factor == pytest.approx(1, rel=0.02)
    assert rates.frames == pytest.approx(60, rel=0.02) and rates.lost == 0
    assert clock.due(2.0 + 1 / 60, 2.0) == pytest.approx(33, abs=1)
    assert clock.due(3.0, 0.0) == 0


def test_time_slept_through_is_counted_as_lost_and_not_made_up_for():
    clock = RealTime(0.001, now=0.0)
    assert clock.due(2.0, 1.0) == 250
    assert clock.rates().lost == pytest.approx(1.75)
    assert clock.due(2.1, 1.0) == 100


def reading(start, end, before_last, with_last):
    return Reading(None, None, np.array([start, end]), np.array([before_last, with_last]))  # type: ignore[arg-type]


def test_the_watch_tells_a_rise_from_a_change_from_outside():
    watch = EnergyWatch()
    assert watch.see(reading(np.nan, np.nan, 0, 0), changed=True, stepped=False).violations == 0
    seen = watch.see(reading(1.0, 0.9, 0.1, 0.11), changed=True)
    assert seen == pytest.approx((0.9, 0.9, 0))
    seen = watch.see(reading(0.89, 0.8, 0.09, 0.1), changed=False)
    assert seen == pytest.approx((0.8, 0.8, 0))
    seen = watch.see(reading(2.0, 1.9, 0.1, 0.1), changed=True)  # the goal was moved
    assert seen == pytest.approx((1.9, 1.9, 0))
    seen = watch.see(reading(1.9, 1.95, 0.0, 0.0), changed=False)
    assert seen.violations == 1
    assert watch.see(reading(np.nan, np.nan, 0, 0), changed=False, stepped=False) == seen
    for start, end in ((1.9, np.nan), (np.nan, 1.9), (np.nan, np.nan)):
        seen = watch.see(reading(start, end, 0.0, 0.0), changed=False)
    assert seen.violations == 4 and np.isnan(seen.energy)
    seen = watch.see(reading(1.0, 0.9, 0.1, 0.1), changed=False)
    assert seen == pytest.approx((0.9, 0.9, 4))


def sample(recorder, count=60, dt=0.02):
    for k in range(count):
        recorder.add(5.0 + k * dt, np.full(7, 0.01 * k), np.array([0.0, 0.0, 0.01 * k]))


def test_recordings_are_kept_played_back_and_thrown_away():
    recorder = Recorder()
    sample(recorder)
    recorder.begin()
    sample(recorder)
    recorder.add(5.0, np.zeros(7), np.zeros(3))  # time has not gone on
    recording = recorder.end()
    assert recording.q.shape == (60, 7) and recording.hand.shape == (60, 3)
    assert recording.time[0] == 0 and recording.duration == pytest.approx(59 * 0.02)
    np.testing.assert_allclose(recording.at(0.03), 0.015, rtol=1e-5)
    assert recording.at(2.0) is None
    with pytest.raises(DemonstrationError, match="there is no demonstration 3: 1 are recorded"):
        recorder.discard(2)
    recorder.discard(0)
    assert recorder.recordings == []


def test_a_recording_without_motion_or_time_is_not_kept():
    recorder = Recorder()
    recorder.begin()
    with pytest.raises(DemonstrationError, match="is not kept: record again"):
        recorder.end()
    recorder.begin()
    for k in range(50):
        recorder.add(0.02 * k, np.zeros(7), np.zeros(3))
    with pytest.raises(DemonstrationError, match="nothing moved"):
        recorder.end()
    assert recorder.recordings == [] and not recorder.recording


def test_a_saved_set_is_one_that_learning_reads(tmp_path):
    recorder, T = Recorder(), np.eye(4)
    for k in range(3):
        T[0, 3] = 0.1 * k
        recorder.begin(T)
        sample(recorder)
        recorder.end()
    with pytest.raises(DemonstrationError, match="the demonstrations so far have a target frame and this one has none"):
        recorder.begin()
    recorder.save(panda(), tmp_path / "cup")
    found = load_demonstrations(tmp_path / "cup")
    assert found.joint_names == panda().joint_names and len(found) == 3
    assert found[2].pose(TARGET)[0, 3] == 0.2
    np.testing.assert_allclose(found[0].q, recorder.recordings[0].q)
    with pytest.raises(DemonstrationError, match="is not empty"):
        recorder.save(panda(), tmp_path / "cup")
    recorder.discard(2)
    recorder.discard(1)
    with pytest.raises(DemonstrationError, match="at least two"):
        recorder.save(panda(), tmp_path / "one")


def test_the_configuration_beside_a_set_can_be_read(tmp_path):
    from jaxrmp.learning import load_configuration

    for targeted, robot in ((True, "panda"), (False, str(tmp_path / "arm.urdf"))):
        fixed = {} if targeted else {"finger_1": 0.02}
        found = load_configuration(write_configuration(tmp_path / "-a cup", robot, "hand", targeted, fixed))
        assert (found.name, found.object, found.robot) == ("a_cup", TARGET * targeted, robot)
        assert found.fixed_joints == fixed
        assert [subtask.frame for subtask in found.subtasks] == ["hand"] * 3


def test_gains_are_found_and_set_without_changing_their_shape():
    from jaxrmp._pytree import single
    from jaxrmp.viewer import reach_content

    policy = single(reach_content(self_collision=False).policy)
    assert {"hand_position.gain", "hand_orientation.stiffness", "collision_avoidance.barrier"} <= {
        gain.path for gain in gains_of(policy)
    }
    changed = with_gain(policy, "hand_position.gain", 9.0)
    assert gain_value(changed, "hand_position.gain") == 9.0 and gain_value(policy, "hand_position.gain") != 9.0
    assert jax.tree.structure(changed) == jax.tree.structure(policy)
    like = [(np.shape(a), np.asarray(a).dtype) for a in jax.tree.leaves(policy)]
    assert [(np.shape(a), np.asarray(a).dtype) for a in jax.tree.leaves(changed)] == like


def test_the_arms_shapes_have_the_size_of_its_geometry():
    pytest.importorskip("trimesh")
    from jaxrmp.kinematics import PANDA_MODEL
    from jaxrmp.viewer._shapes import seen, shapes_of
    from jaxrmp.world import geometry_of_model

    model = geometry_of_model(PANDA_MODEL)
    shapes = shapes_of(model, seen(model))
    (first,) = [s for s in shapes if model.body(s.body).name == "panda_link1"]
    np.testing.assert_allclose(first.vertices.min(0), [-0.06, -0.06, -0.333 - 0.06], atol=2e-3)
    np.testing.assert_allclose(first.vertices.max(0), [0.06, 0.06, -0.05 + 0.06], atol=2e-3)
    assert sum(s.flat for s in shapes) == 2  # the fingers
    assert all(s.faces.max() < len(s.vertices) for s in shapes)


def test_a_port_in_use_is_an_error_that_says_what_to_do():
    pytest.importorskip("viser")
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(ConfigurationError, match=f"port {port} cannot be had.*--port 0"):
            open_server(port, "test")
    with pytest.raises(ConfigurationError, match="port is 70000"):
        open_server(70000, "test")


def test_without_viser_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(MissingDependencyError, match=r"jaxrmp\[viewer\]"):
        open_server(0, "test")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["view", "--scene", "door"], "belong to a skill"),
        (["view", "nowhere.npz"], "there is no skill file"),
        (["view", "nowhere.npz", "--frame", "x"], "a skill has its control points"),
        (["view", "--robot", "nowhere.urdf"], "nowhere.urdf"),
        (["view", "--replay", "full/meta.json", "--balls", "0"], "expected an NPZ file with time"),
        (["view", "--host", "0.0.0.0"], "Give --password, or leave --host out"),
        (["view", "--host", "0.0.0.0", "--password", "short"], "8 at least"),
        (["view", "--frame", "panda_hnd"], "Did you mean 'panda_hand'"),
        (["teach", "--robot", "nowhere.urdf", "--out", "x"], "nowhere.urdf"),
        (["teach", "--out", "full"], "is not empty"),
    ],
)
def test_mistakes_are_explained_before_a_page_is_opened(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "meta.json").write_text("{}")
    assert main(arguments) == 1
    assert message in capsys.readouterr().err


def test_the_loop_tells_the_watch_of_a_change_from_outside_and_of_no_other(monkeypatch):
    pytest.importorskip("viser")
    from jaxrmp.viewer import reach_content

    content = reach_content(balls=0, self_collision=False)
    shares = np.ones(len(switches(content.policy.tree(content.T_world_target, content.world))), np.float32)
    push = Push(np.zeros(3, np.float32), np.float32(0), np.float32(0))
    goal = content.T_world_target.astype(np.float32)
    given = [Situation(content.policy, goal, content.world, shares, push)]
    loop = LiveLoop(lambda: replace(given[-1]), content.q, ("panda_hand",), content.hand)
    told, see = [], loop._watch.see
    monkeypatch.setattr(loop._watch, "see", lambda *seen, **how: told.append(seen[1]) or see(*seen, **how))
    for moved in (False, False, True, False):
        if moved:
            given.append(replace(given[-1], T_world_target=goal + np.float32(0.1) * np.eye(4, k=3, dtype=np.float32)))
        loop._step(2, Rates(0.0, 0.0, 1.0, 0.0))
    assert told == [True, False, True, False]


def test_a_page_says_at_its_top_that_its_policy_avoids_nothing_and_draws_no_distance():
    pytest.importorskip("viser")
    from jaxrmp.viewer import Viewer, reach_content

    content = reach_content(balls=1, self_collision=False)
    viewer = Viewer(content._replace(policy=replace(content.policy, spheres=None)), port=0)
    try:
        assert ["avoids nothing" in note.content for note in viewer.notes] == [True]
        assert viewer._distances == () and "collision_avoidance" not in viewer.switches.names
    finally:
        viewer.stop()


def test_a_page_says_at_its_top_that_its_policy_is_not_told_of_the_furniture():
    pytest.importorskip("viser")
    from jaxrmp.scenes import scene
    from jaxrmp.viewer import Viewer, reach_content

    viewer = Viewer(reach_content(balls=0, self_collision=False)._replace(furniture=scene("drawer")), port=0)
    try:
        assert any("not told of the furniture: nothing keeps it off" in note.content for note in viewer.notes)
    finally:
        viewer.stop()


def test_a_policy_that_takes_no_hand_to_a_place_is_not_said_to_be_there():
    pytest.importorskip("viser")
    from jaxrmp.viewer import reach_content

    content = reach_content(balls=0, self_collision=False)
    push = Push(np.zeros(3, np.float32), np.float32(0), np.float32(0))
    turning = replace(content.policy, tasks=tuple(replace(task, position=None) for task in content.policy.tasks))
    T = content.T_world_target.astype(np.float32)
    for policy, somewhere in ((content.policy, True), (turning, False)):
        names = switches(policy.tree(T, content.world))
        situation = Situation(policy, T, content.world, np.ones(len(names), np.float32), push)
        found = examine(situation, Motion.at_rest(content.q.astype(np.float32)), content.hand, names)
        assert np.isfinite(found.goal) == somewhere


def sizes(world):
    """What must not change, for nothing to be compiled again."""
    return jax.tree.structure(world), [np.shape(leaf) for leaf in jax.tree.leaves(world)]


def test_obstacles_are_dragged_added_and_changed_in_slots_of_a_fixed_number():
    pytest.importorskip("viser")
    from jaxrmp.viewer import Viewer, reach_content
    from jaxrmp.viewer._obstacles import at_first

    content = reach_content(balls=1)
    viewer = Viewer(content, port=0)
    try:
        obstacles, handle = viewer.obstacles, viewer.server.scene.get_handle_by_name
        world = obstacles.read()
        assert sizes(world) == sizes(at_first(content.balls, content.world))
        assert np.asarray(world.spheres.active).tolist() == [True, False, False]
        assert not np.asarray(world.boxes.active).any() and not np.asarray(world.capsules.active).any()
        ball, start = handle("/obstacle_1"), np.asarray(world.spheres.center)[0]
        ball.position = start + [0.3, 0.0, 0.0]  # as solid things move, not as a mouse jumps, however long a frame took
        assert 0 < obstacles.read(0.2).spheres.center[0, 0] - start[0] < 0.01
        np.testing.assert_allclose(obstacles.read().spheres.center[0, 0] - start[0], 0.3)  # no time passes
        obstacles.draw(obstacles.read())
        np.testing.assert_allclose(handle("/solid_1").position, ball.position)
        assert handle("/solid_1/sphere") is not None
        first, second = obstacles.slots[:2]
        first.kind.value, first.length.value, ball.wxyz = "box", 0.3, (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)
        obstacles.add()
        turned = obstacles.read(0.01)  # no corner is faster than solid things, nor does it grow so
        assert 0.15 < turned.boxes.half_extents[0, 2] < 0.16 and turned.boxes.T_world_box[0, 2, 2] > 0.99
        changed = obstacles.read()
        assert sizes(changed) == sizes(world)
        assert np.asarray(changed.boxes.active).tolist() == [True, False, False]
        assert np.asarray(changed.spheres.active).tolist() == [False, True, False]
        np.testing.assert_allclose(changed.signed_distance(jnp.asarray(ball.position) + jnp.array([0.5, 0, 0]))[6], 0.2)
        obstacles.draw(changed)
        assert handle("/solid_1/sphere") is None and handle("/solid_1/box") is not None
        first.kind.value, second.kind.value = "capsule", "off"
        np.testing.assert_allclose(obstacles.read().capsules.start[0], ball.position - np.array([0.3, 0, 0]), atol=1e-6)
        assert obstacles.present == 1
        poses = np.tile(np.eye(4), (len(viewer.arm.frames), 1, 1))
        viewer.arm.move(poses)
        nodes = [handle(f"/arm/{name}") for name in viewer.arm.frames[:2]]
        for node in nodes:
            node.position = (9.0, 9.0, 9.0)
        poses[0, 0, 3] = 0.1
        viewer.arm.move(poses)  # the page is told of what has moved
        assert [node.position[0] for node in nodes] == [0.1, 9.0]
    finally:
        viewer.stop()


def test_time_that_was_lost_is_told_for_five_seconds():
    clock = RealTime(0.001, now=0.0)
    clock.due(2.0, 1.0)
    assert clock.rates().lost == pytest.approx(1.75)
    for t in np.arange(2.1, 6.9, 0.1):
        clock.due(t, 1.0)
    assert clock.rates().lost == pytest.approx(1.75)
    clock.due(7.1, 1.0)
    assert clock.rates().lost == 0 and clock.lost == pytest.approx(1.75)


def test_the_page_says_what_is_not_checked_and_never_that_all_is_well():
    both, names = ("to obstacles", "to itself"), ("posture", "self_collision")
    assert banners((*names, "collision_avoidance"), both, True) == []
    assert banners(names, both[:1], True) == [
        "The policy has no leaf collision_avoidance: nothing keeps it off the obstacles on this page. Not checked."
    ]
    assert banners(("posture",), (), True) == []
    assert banners(("posture",), both, False) == [
        "The arm has no collision spheres: it avoids nothing, and distances are not checked."
    ]
    assert avoidance_words(names, both, np.ones(2), {}, 0) == "to obstacles: not checked"
    assert avoidance_words(names, ("to itself",), np.ones(2), {"self_collision.barrier": 1.0}, 0) == ""
    assert "self_collision is switched off" in avoidance_words(names, both, np.array([1.0, 0.0]), {}, 0)
    assert "barrier of zero" in avoidance_words(names, ("to itself",), np.ones(2), {"self_collision.barrier": 0.0}, 0)
    assert avoidance_words(names, (), np.ones(2), {}, 2) == "2 obstacles not finite, ignored"
    assert energy_words((), np.nan, 0).endswith("not checked yet")
    assert energy_words(("flow",), 1.0, 0).startswith("not certified: flow")
    assert "of collisions this says nothing" in energy_words((), 1.0, 0)


def test_one_frame_is_not_frames():
    assert "not a number, in 1 frame" in energy_words((), 1.0, 1) and not energy_words((), 1.0, 1).endswith("frames")
    assert energy_words((), 1.0, 2).endswith("in 2 frames")


def test_the_way_to_the_goal_is_told_in_words():
    assert goal_words(0.0031, True, {}) == "at the goal: 3.1 mm off"
    assert goal_words(0.123, False, {}) == "12 cm to the goal"
    assert goal_words(0.123, True, {"to obstacles": 0.2}) == "**at rest 12 cm from the goal: out of reach from here**"
    assert "held off**: 12 mm to obstacles" in goal_words(0.05, True, {"to obstacles": 0.012})
    assert goal_words(0.05, True, {}, off=True).endswith("**: leaves are switched off")
    assert goal_words(np.nan, True, {}) == "distance to the goal: not checked"
    rest = Resting()
    seen = [rest.see(t, np.full(2, v), False) for t, v in ((0, 0.5), (1, 0.0), (1.9, 0.0), (2.0, 0.0), (2.1, 0.3))]
    assert seen == [False, False, False, True, False]


def test_axes_end_at_round_numbers():
    found = [round_end(x) for x in (0.0, 3e-5, 0.012, 0.2, 118.0, 1000.0, np.nan)]
    np.testing.assert_allclose(found, [0.01, 0.01, 0.02, 0.2, 200.0, 1000.0, 0.01])


def test_gains_are_saved_in_files_that_are_read_again(tmp_path, door_learning):
    from jaxrmp._pytree import single
    from jaxrmp.learning import load_skill
    from jaxrmp.viewer import reach_content

    policy, file = single(reach_content(self_collision=False).policy), tmp_path / "gains.toml"
    assert "--gains" in save_gains({"hand_position.gain": 9.5, "posture.stiffness": 0.0}, file, None, False)
    tuned = with_gains_of(policy, file)
    assert gain_value(tuned, "hand_position.gain") == 9.5 and gain_value(tuned, "posture.stiffness") == 0
    with pytest.raises(ConfigurationError, match="is there already"):
        save_gains({"posture.stiffness": 1.0}, file, None, False)
    save_gains({"posture.stiffness": 1.0}, file, None, True)
    assert file.read_text().count("=") == 1
    for text, message in (
        ("hand_position = 1", "hand_position is no gain"),
        ("[hand_position]\ngain = -1.0", "zero or more"),
        ("[collision_avoidance]\nreach = 0", "more than zero"),
        ("?", "cannot be read as TOML"),
    ):
        file.write_text(text)
        with pytest.raises(ConfigurationError, match=message):
            with_gains_of(policy, file)
    with pytest.raises(ConfigurationError, match="ends in .toml, for the gains alone.$"):
        save_gains({"posture.stiffness": 1.0}, tmp_path / "a.npz", None, False)
    copy = tmp_path / "copy.skill.npz"
    said = save_gains({"learned.speed": 0.31, "hand_orientation.weight": 1.0}, copy, door_learning.skill, False)
    assert "with learned.speed in" in said and said.endswith("no place for them: hand_orientation.weight.")
    assert gain_value(load_skill(copy), "learned.speed") == pytest.approx(0.31)


def test_a_page_saves_gains_where_the_command_runs_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert place_for_gains("tuned/gains.toml") == Path("tuned/gains.toml")
    (tmp_path / "out").symlink_to(tmp_path.parent)
    for name in ("../gains.toml", "/etc/gains.toml", "out/gains.toml", "a/../../gains.toml"):
        with pytest.raises(ConfigurationError, match="where the command runs"):
            place_for_gains(name)


def test_series_of_a_chart_are_drawn_as_those_of_figures_and_no_two_alike():
    drawn = [stroke(k) for k in range(20)]
    assert [s["stroke"] for s in drawn[:6]] == list(SERIES[:6]) and not any("dash" in s for s in drawn[:7])
    assert len({(s["stroke"], s.get("dash")) for s in drawn}) == 20
