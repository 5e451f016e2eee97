"""Skills of how a hand is turned alone: the coordinates, where they end, what is learned, and from where it arrives."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial
from scipy.spatial.transform import Rotation

from jaxrmp import ConfigurationError, TrainingError, certificate, compose, pullback, stack
from jaxrmp._rotations import rotation_angle, rotation_of_vector
from jaxrmp.cli import main
from jaxrmp.cli._output import validation_table
from jaxrmp.kinematics import panda
from jaxrmp.learning import (
    Subtask,
    configuration_from_dict,
    initial_flow,
    learn,
    load_configuration,
    load_demonstrations,
    load_skill,
    on_robot,
    prepare,
    validate,
)
from jaxrmp.learning._hand_flow import _highest, triangle_round
from jaxrmp.learning._hand_maps import BeyondTurn, HandPose, HandTurn
from jaxrmp.learning._reproduce import energy_increase, itself, rollouts_of
from jaxrmp.learning._turn_attractor import TurnAttractor
from jaxrmp.leaves import CruisingAttractor, Damping

from .hand_paths import START, as_set, configuration_of, hand, pour, written

CONFIGURATION = configuration_of("tilt", "orientation")
TARGETS = triangle_round(np.zeros(3), 0.15) @ Rotation.from_rotvec([0.3, -0.4, 0.2]).as_matrix().T


def stacked(turn, shift=0.0):
    """A triangle turned from the targets by the vector `turn`, rad, as `Stacked` has it [9]."""
    points = TARGETS @ Rotation.from_rotvec(turn).as_matrix().T + shift
    return jnp.asarray((points - TARGETS).reshape(-1) / np.sqrt(3))


@pytest.fixture(scope="module")
def bend():
    """A flow of three coordinates that is not the identity."""
    flow = initial_flow(0, 3, couplings=6, hidden=16, length=0.12)
    weights = np.random.default_rng(1).normal(size=flow.couplings.weights_3.shape) / 8
    return replace(flow, couplings=replace(flow.couplings, weights_3=jnp.asarray(weights, jnp.float32))).centred()


@pytest.fixture(scope="module")
def node(bend):
    """Its policy on the stacked corners of a triangle, and the same of poses."""
    leaf = TurnAttractor(_highest(bend, 0.15, 0.03), length=0.15)
    targets = jnp.asarray(TARGETS)
    return pullback(stack(compose(HandTurn(targets), bend), BeyondTurn(targets)), leaf)


@pytest.fixture(scope="module")
def tilt(once):
    """The folder of a skill that was learned by the command line, from a file with flips of sign."""

    def make(folder):
        file = written(folder, flips=True)
        (folder / "tilt.toml").write_text(CONFIGURATION)
        assert main(["learn", str(folder / "tilt.toml"), "--demos", str(file), "--out", str(folder), "-q"]) == 0

    return once("tilt", make)


@pytest.fixture(scope="module")
def skill(tilt):
    return load_skill(tilt / "tilt.skill.npz")


def test_coordinates_of_a_turn_are_those_of_a_pose_wherever_the_hand_is():
    with jax.enable_x64(True):
        targets, axis = jnp.asarray(TARGETS), np.array([2.0, -1.0, 2.0]) / 3
        turn, pose = HandTurn(targets), HandPose(targets)
        for angle in (0.0, 0.1, 1.0, 2.26):
            x = stacked(angle * axis, shift=[0.4, -0.2, 0.7])
            np.testing.assert_allclose(turn(x), 0.8 * 0.15 * 4 * np.tan(angle / 4) * axis, atol=1e-12)
            np.testing.assert_allclose(turn(x), pose(x)[3:], atol=1e-12)
        beyond = [float(BeyondTurn(targets)(stacked(np.deg2rad(a) * axis))[0]) for a in (90, 129.9, 132, 150, 170, 180)]
        assert beyond[:2] == [0.0, 0.0] and (np.diff(beyond[1:]) > 0).all()
        assert beyond[-1] == pytest.approx(1.0, abs=1e-9)
        for angle in (np.pi * (1 - 1e-9), np.pi):
            for psi in (turn, BeyondTurn(targets)):
                assert all(np.isfinite(part).all() for part in psi.pushforward(stacked(angle * axis), jnp.ones(9)))


def test_the_attractor_is_a_cruising_one_up_to_where_coordinates_end():
    with jax.enable_x64(True):
        leaf, plain = TurnAttractor(0.5), CruisingAttractor(jnp.zeros(3))
        x, xd = jnp.array([0.1, -0.2, 0.05, 0.0]), jnp.array([0.3, 0.1, -0.2, 0.0])
        force = leaf(x, xd)
        np.testing.assert_allclose(force.f[:3], plain(x[:3], xd[:3]).f, atol=1e-12)
        np.testing.assert_allclose(force.M[:3, :3], plain(x[:3], xd[:3]).M, atol=1e-12)
    with pytest.raises(ConfigurationError, match="taper"):
        TurnAttractor(0.5, taper=0.0)


def test_it_is_certified_on_all_rotations_and_its_energy_rises_to_the_half_turns(node):
    """So it has no place of rest beyond 130 degrees but there, whatever the flow is."""
    with jax.enable_x64(True):
        node = jax.tree.map(lambda a: jnp.asarray(a, float), node)
        rng = np.random.default_rng(0)
        axes = rng.normal(size=(200, 3))
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        angles = np.append(rng.uniform(0, np.pi, 180), np.linspace(np.deg2rad(170), np.pi, 20))
        begun = Rotation.from_rotvec(angles[:, None] * axes).as_matrix()

        def found(R, turn, rate):
            """At a rotation away from `R` by `turn` [3], rad: three coordinates, in which M is regular."""
            places = lambda v: (TARGETS @ (rotation_of_vector(v) @ R).T - TARGETS).reshape(-1) / 3**0.5  # noqa: E731
            return certificate(pullback(places, node) + Damping(1e-3), turn, rate)

        turns, rates = jnp.asarray(rng.uniform(-0.01, 0.01, (200, 3))), jnp.asarray(rng.normal(size=(200, 3)))
        residual = jax.jit(jax.vmap(found))(jnp.asarray(begun), turns, rates).residual
        assert float(residual.max()) < 1e-8
        along = np.deg2rad(np.linspace(130.5, 180, 100))
        x = jnp.stack([jnp.stack([stacked(a * axis) for a in along]) for axis in axes[:40]])
        energy = jax.jit(jax.vmap(jax.vmap(lambda x: node.energy(x, jnp.zeros_like(x)))))(x)
        assert (np.diff(energy, axis=1) > 0).all()


def test_an_orientation_is_a_subtask_of_its_own():
    content = {"name": "tilt", "subtasks": [{"name": "cup", "frame": "panda_hand", "kind": "orientation"}]}
    assert configuration_from_dict(content).of_turn
    other = {"name": "tip", "frame": "panda_link7"}
    with pytest.raises(ConfigurationError, match="have an orientation among them"):
        configuration_from_dict({**content, "subtasks": [*content["subtasks"], other]})
    with pytest.raises(ConfigurationError, match="'cup' is an orientation, of which method 'paper' knows nothing"):
        configuration_from_dict({**content, "method": "paper"})
    with pytest.raises(
        ConfigurationError, match=r"'cup' has offset \(0.0, 0.0, 0.1\), but an orientation is of the whole"
    ):
        Subtask("cup", "panda_hand", (0.0, 0.0, 0.1), "orientation")


def test_it_is_learned_and_judged_by_turn_alone(tilt, skill, tmp_path, capsys):
    file, config = tilt / "pour.npz", tilt / "tilt.toml"
    assert main(["check", str(config), "--demos", str(file)]) == 0
    assert "cup: orientation of panda_hand, wherever it is" in capsys.readouterr().out
    assert skill.turned and skill.of_turn and skill.hand(np.eye(4)) is None
    assert "<th>turn at the goal, degrees</th>" in (tilt / "report.html").read_text()
    errors = tmp_path / "errors.json"
    assert main(["reproduce", str(tilt / "tilt.skill.npz"), "--json", str(errors), "-q"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"^demo +turn_deg +goal_turn_deg +energy", said, re.MULTILINE)
    assert re.search(r"^mean +\d+\.\d\d +0\.\d\d ", said, re.MULTILINE) and "a turn alone was learned" in said
    found = json.loads(errors.read_text())
    for e in found["per_demo"]:
        assert {e[name] for name in ("dtw_cm", "frechet_cm", "goal_cm", "position_percent")} == {None}
        assert e["turn_deg"] < 10 and e["goal_turn_deg"] < 0.5 and e["energy_increase"] < 1e-5
        assert e["rests_away_from"] == []
    assert main(["run", str(tilt / "tilt.skill.npz"), "--scene", "drawer_closing"]) == 1
    assert "learned of a turn alone, and scenes judge where the hand arrives" in capsys.readouterr().err


def test_a_place_changes_nothing_and_an_object_turns_it_along(skill):
    robot, q = panda(), jnp.asarray(START + 0.2, jnp.float32)
    T = jnp.asarray(skill.T_world_object)
    moved = T.at[:3, 3].add(jnp.array([0.2, -0.3, 0.1]))
    turned = moved.at[:3, :3].set(jnp.asarray(Rotation.from_rotvec([0, 0, 0.5]).as_matrix(), T.dtype) @ T[:3, :3])
    here, there, other = (skill.tree(robot, at)(q, 0 * q) for at in (T, moved, turned))
    np.testing.assert_allclose(here.f, there.f, atol=1e-3 * float(jnp.abs(here.f).max()))
    assert float(jnp.abs(here.f - other.f).max()) > 0.1 * float(jnp.abs(here.f).max())


@pytest.fixture(scope="module")
def prepared(tilt):
    configuration = load_configuration(tilt / "tilt.toml")
    poses = configuration.followed
    demonstrations = load_demonstrations(tilt / "pour.npz", configuration.recording, panda(), poses=poses)
    return prepare(configuration, panda(), demonstrations)


def test_its_whole_tree_is_certified(skill, prepared, assert_skill_certified):
    assert_skill_certified(SimpleNamespace(skill=skill, prepared=prepared))


def test_what_it_is_learned_from_has_no_place(prepared):
    assert max(float(np.abs(points.mean(1)).max()) for points in prepared.points) < 1e-12
    lifted = hand(prepared.joints.q[0])[:, 2, 3]
    assert np.ptp(lifted) > 0.05  # which the hand has


def test_it_arrives_from_turns_beyond_its_coordinates(skill):
    """From all over the joint range; some starts are beyond 164 degrees, where nothing is left of the flow."""
    robot = panda()

    def left(q):
        return np.degrees(rotation_angle(hand(q)[:, :3, :3] @ np.asarray(skill.R_object_hand).T))

    q = np.random.default_rng(3).uniform(robot.lower + 0.2, robot.upper - 0.2, (300, 7))
    starts = q[left(q) > 140][:12]
    assert (left(starts) > 164).sum() >= 3
    rollouts = rollouts_of(Partial(itself, skill.tree(robot)), (), starts, duration=40.0)
    assert left(rollouts.q[:, -1]).max() < 2
    assert max(energy_increase(energy) for energy in rollouts.energy) < 0.01


def test_demonstrations_that_turn_too_far_are_refused_by_number_and_degrees():
    far = pour(1)
    base = far[-1, :3, :3].copy()
    far[:, :3, :3] = Rotation.from_rotvec(np.linspace(2.6, 0, len(far))[:, None] * [0, 0, 1]).as_matrix() @ base
    content = {"name": "tilt", "method": "flow", "subtasks": [{"name": "cup", "frame": "panda_hand"}]}
    content["subtasks"][0]["kind"] = "orientation"
    demonstrations = on_robot(as_set([pour(0), far]), panda(), "panda_hand", START)
    with pytest.raises(TrainingError, match="demonstration 1: the hand turns by 149 degrees from how it ends"):
        learn(configuration_from_dict(content), panda(), demonstrations)


def test_each_left_out_is_judged_by_turn_alone(tilt):
    few = {"flow.updates": 100, "flow.couplings": 4, "flow.hidden": 16}
    configuration = load_configuration(tilt / "tilt.toml", few)
    demonstrations = load_demonstrations(
        tilt / "pour.npz", configuration.recording, panda(), poses=configuration.followed
    )
    found = validate(configuration, panda(), demonstrations)
    assert found.passed >= 3 and found.held_out["dtw_cm"] is None and 0 < found.held_out["turn_deg"] < 30
    said = validation_table(found.as_dict())
    assert "dtw_cm" not in said and "-" not in said.splitlines()[-2].split()
    assert said.splitlines()[-2].split()[:2] == ["mean", f"{found.held_out['turn_deg']:.2f}"]
