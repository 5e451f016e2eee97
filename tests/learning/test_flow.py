"""Flows: the diffeomorphism, its training, and the skill that it becomes."""

import json
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxrmp import ConfigurationError, TrainingError, acceleration
from jaxrmp._task_map import pushforward_by_autodiff
from jaxrmp.cli._report_pages import learning_page
from jaxrmp.cli._reproduce import result_dict
from jaxrmp.evaluation._stability import flow_metrics
from jaxrmp.kinematics import forward_kinematics, panda
from jaxrmp.learning import (
    FlowSettings,
    Fold,
    Validation,
    initial_flow,
    learn,
    learning_report,
    load_configuration,
    load_skill,
    rays,
    reproduce,
    resample_by_arc_length,
    save_skill,
    train_flow,
)
from jaxrmp.learning._hand_flow import _followed, hand_points
from jaxrmp.learning._hand_maps import HandPose
from jaxrmp.learning._learn_flow import check_turns
from jaxrmp.policies import whole_arm_policy
from jaxrmp.visualization import loss_figure, width_figure
from jaxrmp.world import World

CONFIGS = Path(__file__).parents[2] / "configs"
FEW = {"method": "flow", "flow.updates": 300}


@pytest.fixture(scope="module")
def bend():
    """A flow that is not the identity, of five coordinates, in double precision."""
    rng = np.random.default_rng(1)
    flow = initial_flow(0, 5, couplings=6, hidden=16, length=0.3)
    weights = rng.normal(size=flow.couplings.weights_3.shape) / 4
    return replace(flow, couplings=replace(flow.couplings, weights_3=jnp.asarray(weights, jnp.float32))).centred()


@pytest.fixture(scope="module")
def learning(door_flow):
    return door_flow


def test_a_flow_keeps_the_origin_and_its_inverse_undoes_it(bend):
    x = jnp.asarray(np.random.default_rng(0).normal(size=(500, 5)), jnp.float32)
    y = jax.vmap(bend)(x)
    assert float(jnp.abs(y - x).max()) > 0.1
    assert float(jnp.abs(bend(jnp.zeros(5))).max()) < 1e-6
    np.testing.assert_allclose(jax.vmap(bend.inverse)(y), x, atol=1e-5, rtol=1e-5)  # of single precision


def test_its_pushforward_is_what_autodiff_finds(bend):
    with jax.enable_x64(True):
        rng = np.random.default_rng(0)
        for x, xd in rng.normal(size=(5, 2, 5)):
            found, expected = bend.pushforward(x, xd), pushforward_by_autodiff(bend.__call__, x, xd)
            for a, b in zip(found, expected, strict=True):
                assert a.dtype == jnp.float64
                np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)


def test_rays_follow_curves_that_no_potential_of_one_path_can():
    """Half circles from one place to the origin, and their mirror images: turned by 180 degrees on the way."""
    angle = np.linspace(np.pi, 0, 60)
    arcs = [np.stack([size * (np.cos(angle) - 1), up * size * np.sin(angle)], 1) for size, up in ((0.2, 1), (0.2, 1.3))]
    fit = train_flow(arcs, np.zeros((0, 2)), FlowSettings(updates=600, couplings=8, hidden=16), seed=0)
    assert fit.losses[-50:].mean() < 0.1 * fit.losses[:20].mean()
    starts = jnp.asarray(np.stack([arc[0] for arc in arcs]), jnp.float32)
    found = np.asarray(rays(fit.flow, starts, jnp.linspace(1, 0, 100)))
    for ray, arc in zip(found, arcs, strict=True):
        error = np.linalg.norm(resample_by_arc_length(ray, 100) - resample_by_arc_length(arc, 100), axis=1)
        assert error.max() < 0.05  # 8 % of the way; a straight line is 0.2 m off
    again = train_flow(arcs, np.zeros((0, 2)), FlowSettings(updates=600, couplings=8, hidden=16), seed=0)
    np.testing.assert_array_equal(fit.losses, again.losses)


def test_a_learned_flow_reproduces_and_says_how_it_was_learned(learning):
    assert learning.skill.method == "flow" and learning.paper is None and learning.skill.parts == ("hand",)
    errors = learning.reproduction.mean
    assert errors["dtw_cm"] < 1.5 and errors["goal_cm"] < 0.1 and errors["energy_increase"] <= 1e-3
    report = learning_report(learning)
    assert report["method"] == "flow" and report["why"] == "asked for" and report["subtasks"] == []
    assert report["flow"]["last_loss"] < report["flow"]["first_loss"]
    assert 0 < report["flow"]["least_stretch"] < report["flow"]["largest_stretch"]


def test_its_policy_is_certified(learning, assert_skill_certified):
    assert_skill_certified(learning)


def test_it_goes_where_the_object_went_and_its_funnel_with_it(learning, door):
    skill, robot = learning.skill, panda()
    T = np.array(skill.T_world_object, float)
    T[:3, 3] += [0.03, -0.05, 0.02]
    moved = skill.tree(robot, T)
    funnel = next(leaf for leaf in moved.leaves() if leaf.name == "funnel")
    hand = jax.vmap(lambda q: forward_kinematics(robot, q, "panda_link7")[:3, 3])
    gone = np.asarray(hand(funnel.postures) - hand(skill.flow.funnel.postures))
    assert np.median(np.linalg.norm(gone - [0.03, -0.05, 0.02], axis=1)) < 0.01
    gone = reproduce(skill, robot, learning.prepared._replace(poses=np.stack([T] * 4)), own_targets=False)
    last = gone.points[:, -1]  # in the moved object's frame
    np.testing.assert_allclose(last, np.broadcast_to(skill.targets, last.shape), atol=2e-3)


def test_its_funnel_and_posture_go_where_the_targets_went(learning):
    """Targets moved and turned, as of a demonstration that ended elsewhere: the hand's ways move and turn with them."""
    skill, robot = learning.skill, panda()
    turn, gone = Rotation.from_rotvec([0.0, 0.0, 0.15]), np.array([0.02, -0.03, 0.01])
    targets = np.asarray(skill.targets, float)
    targets = turn.apply(targets - targets.mean(0)) + targets.mean(0) + gone
    tree = skill.tree(robot, targets=jnp.asarray(targets, jnp.float32))
    for name, before in (("funnel", skill.flow.funnel), ("posture", skill.flow.posture)):
        after = next(leaf for leaf in tree.leaves() if leaf.name == name)
        hands = [np.asarray(jax.vmap(skill.task_map(robot))(jnp.asarray(leaf.postures))) for leaf in (before, after)]
        middles = [hand.mean(1) for hand in hands]
        assert np.median(np.linalg.norm(middles[1] - middles[0] - gone, axis=1)) < 0.01  # to first order
        first, last = (hand[-1] + np.asarray(skill.targets) for hand in hands)
        np.testing.assert_allclose(
            last - last.mean(0), turn.apply(first - first.mean(0)), atol=0.1 * np.abs(first - first.mean(0)).max()
        )
    own = reproduce(skill, robot, learning.prepared)
    assert own.mean["goal_cm"] < 0.02  # the posture does not pull the hand off


def test_funnels_of_version_6_lead_from_where_they_wall_in(learning, tmp_path):
    file = save_skill(learning.skill, tmp_path / "new.skill.npz")
    with np.load(file) as archive:
        arrays = dict(archive)
    header = json.loads(arrays.pop("header.json").tobytes())
    header["version"] = 6
    del header["configuration"]["flow"]["onset"], arrays["funnel/onset"], arrays["posture/onset"]
    header["arrays"] = {name: [str(a.dtype), list(a.shape)] for name, a in arrays.items()}
    old = tmp_path / "old.skill.npz"
    np.savez(old, **{"header.json": np.frombuffer(json.dumps(header).encode(), np.uint8)}, **arrays)
    loaded = load_skill(old)
    assert loaded.flow.funnel.onset == loaded.flow.funnel.inner == learning.skill.flow.funnel.inner
    assert loaded.configuration.flow.onset == learning.skill.configuration.flow.inner


def test_its_tree_is_a_function_of_where_the_object_is(learning):
    """Under jit, vmap and grad, and with or without the leaves on the joints."""
    skill, robot = learning.skill, panda()
    q = jnp.asarray(robot.middle, jnp.float32)
    T = jnp.asarray(skill.T_world_object)

    @jax.jit
    def act(skill, x):
        return acceleration(skill.tree(robot, T.at[0, 3].add(x)), q, 0 * q)

    plain = acceleration(skill.tree(robot, T.at[0, 3].add(0.05)), q, 0 * q)
    np.testing.assert_allclose(act(skill, 0.05), plain, rtol=1e-3, atol=1e-3 * float(jnp.abs(plain).max()))
    slopes = jax.jit(jax.vmap(jax.jacfwd(act, argnums=1), (None, 0)))(skill, jnp.linspace(0, 0.1, 3))
    assert slopes.shape == (3, 7) and np.isfinite(slopes).all()
    for left_out in ({"posture": None}, {"funnel": None}, {"funnel": None, "posture": None}):
        less = replace(skill, flow=replace(skill.flow, **left_out))
        assert np.isfinite(act(less, 0.05)).all()
    only = replace(skill, flow=replace(skill.flow, posture=None)).on_joints(robot, T.at[0, 3].add(0.05)).leaves()
    both = skill.on_joints(robot, T.at[0, 3].add(0.05)).leaves()
    tubes = [next(leaf for leaf in leaves if leaf.name == "funnel").postures for leaves in (only, both)]
    np.testing.assert_array_equal(*tubes)


def test_reports_and_figures_know_it(learning, tmp_path):
    q = np.concatenate(learning.prepared.joints.q)[::10]
    found = flow_metrics(learning.skill, panda(), q)
    assert 0 < found["metric"]["least_eigenvalue"] < found["metric"]["largest_eigenvalue"]
    assert found["metric"]["positive_definite_share"] == 1.0 and found["metric"]["points"] == len(q)
    assert found["goal"]["slope"] < 1e-6 and min(found["goal"]["hessian_eigenvalues"]) > 0
    (line,) = loss_figure(learning).axes[0].lines
    np.testing.assert_allclose(line.get_ydata(), learning.flow.fit.losses)
    with pytest.raises(ConfigurationError, match="has no potentials"):
        width_figure(learning)
    result = result_dict(learning.reproduction, learning.skill, "test")
    assert all(demo["rests_away_from"] == [] for demo in result["per_demo"])
    made = {"configuration": {}, "versions": {}}
    page = learning_page({**learning_report(learning), "reproduction": result}, made, {}, tmp_path / "page.html")
    assert "One flow moves the whole hand" in page.read_text() and "Not validated" in page.read_text()
    errors = {"dtw_cm": 2.25, "frechet_cm": 4.0, "goal_cm": 0.0}
    folds = Validation((Fold(0, "flow", errors, errors), Fold(1, "", None, None, "the flow stretches space")))
    page = learning_page({**learning_report(learning, folds), "reproduction": result}, made, {}, page)
    assert "<td>mean</td><td></td><td>2.25</td>" in page.read_text()
    assert "the 1 of 2 folds" in page.read_text() and "the flow stretches space" in page.read_text()


def test_single_precision_stays_so_where_double_is_allowed(learning):
    with jax.enable_x64(True):
        tree = learning.skill.tree(panda())
        form = jax.eval_shape(tree, jnp.asarray(panda().middle, jnp.float32), jnp.zeros(7, jnp.float32))
    assert form.f.dtype == form.M.dtype == jnp.float32


def test_it_is_saved_and_read_back_bit_for_bit(learning, tmp_path):
    skill = learning.skill
    loaded = load_skill(save_skill(skill, tmp_path / "door.skill.npz"))
    assert jax.tree.structure(loaded) == jax.tree.structure(skill)
    for a, b in zip(jax.tree.leaves(skill), jax.tree.leaves(loaded), strict=True):
        np.testing.assert_array_equal(np.asarray(a), np.asarray(b))
    assert loaded.configuration.method == "flow"
    q = jnp.asarray(panda().middle, jnp.float32)
    qdd = [jax.jit(acceleration)(s.tree(panda()), q, 0 * q) for s in (skill, loaded)]
    np.testing.assert_array_equal(*qdd)


def test_a_file_of_version_5_has_a_funnel_that_only_leads_back(learning, tmp_path):
    content = dict(np.load(save_skill(learning.skill, tmp_path / "door.skill.npz")))
    header = json.loads(content.pop("header.json").tobytes())
    for leaf in ("funnel", "posture"):
        del content[f"{leaf}/left"], header["arrays"][f"{leaf}/left"]
    del header["configuration"]["flow"]["lead"]
    header = np.frombuffer(json.dumps(header | {"version": 5}).encode(), np.uint8)
    np.savez(tmp_path / "old.skill.npz", **{"header.json": header}, **content)
    old = load_skill(tmp_path / "old.skill.npz")
    assert old.configuration.flow.lead == 0 and not np.any(old.flow.funnel.left)
    np.testing.assert_array_equal(old.flow.funnel.postures, learning.skill.flow.funnel.postures)


def test_a_whole_arm_leaves_the_turn_to_it(learning):
    policy = whole_arm_policy(learning.skill, panda())
    names = [leaf.name for leaf in policy.tree(learning.skill.T_world_object, World()).leaves()]
    assert "hand_orientation" not in names and {"learned", "funnel"} <= set(names)
    faster = learning.skill.with_gains(0.4, 50.0)
    assert float(faster.flow.attractor.speed) == pytest.approx(0.4) and faster.damping_rate == pytest.approx(50.0)
    assert float(faster.flow.funnel.speed) == pytest.approx(2.0) and float(faster.flow.posture.damping_rate) == 50.0


def test_what_no_flow_can_be_trained_for_is_said_and_the_papers_method_takes_over(door):
    wild = {"flow.updates": 100, "flow.learning_rate": 10.0, "flow.conditioning": 0.0}
    configuration = load_configuration(CONFIGS / "door_reaching.toml", FEW | wild)
    with pytest.raises(TrainingError, match=r"flow.learning_rate|end up to|energy rises"):
        learn(configuration, panda(), door)
    less = {"metric.updates": 50, "potential.widths": [0.05], "potential.basin_starts": 50}
    configuration = load_configuration(CONFIGS / "door_reaching.toml", FEW | wild | less | {"method": "auto"})
    learned = learn(configuration, panda(), door)
    assert learned.skill.method == "paper" and learned.why.startswith("no flow passes: ")


def test_what_judges_a_flow_is_compiled_once_and_before(door, caplog):
    few = {"flow.updates": 20, "flow.couplings": 3, "seed": 3}
    configuration = load_configuration(CONFIGS / "door_reaching.toml", FEW | few)
    with caplog.at_level("DEBUG", "jax._src.dispatch"):
        learned = learn(configuration, panda(), door)
    compiled = [r for r in caplog.records if r.getMessage().startswith("Finished XLA compilation of jit(_rollouts)")]
    assert [r.threadName == "MainThread" for r in compiled] == [False]
    caplog.clear()
    with caplog.at_level("DEBUG", "jax._src.dispatch"):
        again = reproduce(replace(learned.skill, source="elsewhere"), panda(), learned.prepared)
    assert not [r for r in caplog.records if "jit(_rollouts)" in r.getMessage()]
    np.testing.assert_array_equal(again.points, learned.reproduction.points)


def test_the_pose_of_a_hand_and_where_its_turn_no_longer_counts():
    with jax.enable_x64(True):
        corners, _ = hand_points(("hand",) * 3, np.array([[0.0, 0, 0.2], [0.03, 0, 0.203], [-0.03, 0, 0.203]]), 0.15)
        placed = Rotation.from_rotvec([0.3, -0.4, 0.2]).as_matrix()
        targets = corners @ placed.T + [0.1, 0.2, 0.3]
        pose_of = HandPose(jnp.asarray(targets))

        def at(turn, shift):
            R = Rotation.from_rotvec(turn).as_matrix()
            points = (targets - targets.mean(0)) @ R.T + targets.mean(0) + shift
            return np.asarray(pose_of(jnp.asarray((points - targets).reshape(-1) / np.sqrt(3))))

        axis, shift = np.array([2.0, -1.0, 2.0]) / 3, np.array([0.01, -0.02, 0.03])
        np.testing.assert_allclose(at(0 * axis, 0), 0, atol=1e-12)
        for angle in (0.1, 1.0, 2.2):
            expected = [*shift, *(0.8 * 0.15 * 4 * np.tan(angle / 4) * axis)]
            np.testing.assert_allclose(at(angle * axis, shift), expected, atol=1e-12)
        # No step where the axis changes its sign, and nothing that is not finite.
        assert np.abs(at(np.pi * (1 - 1e-4) * axis, shift)[3:]).max() < 1e-6
        assert np.abs(at(np.pi * (1 + 1e-4) * axis, shift)[3:]).max() < 1e-6
        x = jnp.asarray(((targets - targets.mean(0)) @ Rotation.from_rotvec(np.pi * axis).as_matrix().T).reshape(-1))
        carried = pose_of.pushforward((x - (targets - targets.mean(0)).reshape(-1)) / np.sqrt(3), jnp.ones(9))
        assert all(np.isfinite(part).all() for part in carried)


def test_hands_that_turn_too_far_for_a_flow_are_refused_by_demonstration():
    corners = hand_points(("hand",) * 3, np.array([[0.0, 0, 0.2], [0.03, 0, 0.203], [-0.03, 0, 0.203]]), 0.15)[0]
    turns = [Rotation.from_rotvec([0, 0, angle]).as_matrix() for angle in np.linspace(2.6, 0, 20)]
    with pytest.raises(
        TrainingError, match=r"demonstration 1: the hand turns by 149 degrees .* by points with method 'paper'"
    ):
        check_turns([np.stack([corners] * 3), np.stack([corners @ R.T for R in turns])], 0.15)


def test_points_that_stand_for_a_hand():
    rigid = np.array([[0.0, 0.0, 0.2], [0.03, 0.0, 0.203], [-0.03, 0.0, 0.203]])
    offsets, turned = hand_points(("hand",) * 3, rigid, 0.1)
    assert turned and np.linalg.matrix_rank(offsets - offsets.mean(0), 1e-6) == 2
    for frames, points in ((("hand", "elbow", "hand"), rigid), (("hand",) * 2, rigid[:2]), (("hand",), rigid[:1])):
        same, turned = hand_points(frames, points, 0.1)
        assert not turned
        np.testing.assert_array_equal(same, points)


def test_postures_follow_hands_to_first_order_and_never_far():
    """A step in rad that an inverse near a singularity makes is cut, in its direction."""
    q, hands = jnp.zeros((2, 3)), jnp.zeros((2, 1, 3))
    moved = jnp.array([[[0.1, 0.2, -0.1]], [[0.1, 0.2, -0.1]]])
    moves = jnp.stack([jnp.eye(3), 100 * jnp.eye(3)])
    near, far = np.asarray(_followed(q, hands, moved, moves))
    np.testing.assert_allclose(near, [0.1, 0.2, -0.1], rtol=1e-6)
    np.testing.assert_allclose(far, 0.5 * near / np.linalg.norm(near), rtol=1e-6)
