"""Many rollouts at once: how they end, in batches, on several devices and in several processes."""

import importlib.util
import json
import os
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from jaxrmp import ConfigurationError, ShapeError
from jaxrmp.cli._output import write_json
from jaxrmp.evaluation import check_starts, classify_ends, evaluate, regions, replay, sample_starts, starts_around
from jaxrmp.evaluation import rest_points as gather_rest_points
from jaxrmp.evaluation._report import _certificate
from jaxrmp.evaluation._stability import CertificateWatch
from jaxrmp.simulation import Devices, End, KinematicEngine, StopCriteria, largest_batch, simulate

_FILE = Path(__file__).with_name("planar.py")
_SPEC = importlib.util.spec_from_file_location("planar", _FILE)
planar = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(planar)


@pytest.fixture(scope="module")
def problem():
    return planar.planar()


@pytest.fixture(scope="module")
def engine(problem):
    return KinematicEngine(problem, planar.CRITERIA, dt=0.01, chunk=50)


@pytest.fixture(scope="module")
def evaluation(problem, engine):
    return evaluate(engine, problem, planar.LIMITS, sample_starts(problem, 42, seed=3), batch=16)


def test_every_end_is_of_the_kind_of_its_well(evaluation):
    q, kind, starts = evaluation.outcomes.q, evaluation.ends.kind, evaluation.starts
    inside = np.abs(starts[:, 1]) < 0.95
    middle = np.abs(starts[:, 0]) < 0.45
    assert (kind[inside & middle] == End.CONVERGED).all() and (inside & middle).sum() >= 3
    assert (np.linalg.norm(q[kind == End.CONVERGED], axis=1) < 0.01).all()
    beside = inside & (np.abs(np.abs(starts[:, 0]) - 1) < 0.4)
    assert (kind[beside] == End.SPURIOUS).all() and beside.sum() > 3
    np.testing.assert_allclose(np.abs(q[beside, 0]), 1.0, atol=0.05)
    at_limit = np.abs(starts[:, 1]) > 1.05
    assert (kind[at_limit] == End.STOPPED_AT_LIMIT).all() and at_limit.sum() > 10
    assert (evaluation.ends.margin[at_limit, 1] < 0.1).all()
    assert set(evaluation.failing) == set(np.flatnonzero(kind == End.SPURIOUS))


def test_energy_falls_and_the_certificate_holds_on_the_way(evaluation):
    assert (evaluation.energy_increase < 1e-3).all()
    assert (evaluation.residual < 1e-3).all() and (evaluation.growth < 1e-4).all()
    assert evaluation.uncertified == ()


def test_a_certificate_that_is_not_a_number_stays_seen(problem, evaluation, tmp_path):
    watch = CertificateWatch(problem, 3)
    good, bad = np.full((3, 2), 0.1, np.float32), np.full((3, 2), 0.1, np.float32)
    bad[1] = np.nan
    for q in (good, bad, good):
        watch(np.array([0, 1, -1]), SimpleNamespace(q=q, qd=np.zeros((3, 2), np.float32)))
    assert np.isnan(watch.residual).tolist() == np.isnan(watch.growth).tolist() == [False, True, False]
    assert watch.residual[0] < 1e-3 and watch.residual[2] == 0  # the third place was nobody's
    told = _certificate(evaluation._replace(residual=watch.residual, growth=watch.growth))
    assert np.isnan([told["max_residual"], told["max_growth_rate"]]).all() and told["starts_not_a_number"] == 1
    assert _certificate(evaluation)["starts_not_a_number"] == 0
    write_json(told, tmp_path / "told.json")
    assert json.loads((tmp_path / "told.json").read_text())["max_residual"] is None


def test_what_is_kept_on_the_way_is_what_a_trajectory_shows(problem, engine, evaluation):
    i = int(np.argmax(evaluation.ends.kind == End.CONVERGED))
    again = replay(engine, problem, planar.LIMITS, evaluation.starts[i])
    assert again.evaluation.ends.kind[0] == End.CONVERGED
    np.testing.assert_allclose(again.q[-1], evaluation.outcomes.q[i], atol=1e-5)
    np.testing.assert_array_equal(again.q[0], evaluation.starts[i])
    assert again.time[-1] == pytest.approx(evaluation.seconds[i])
    seen = np.minimum(again.q - problem.lower, problem.upper - again.q).min()
    assert evaluation.outcomes.track.margin[i] == pytest.approx(seen, abs=0.02)
    away = np.linalg.norm(again.q - [-1.5, -1.5], axis=1).min() - 0.3
    assert evaluation.outcomes.track.clearance[i] == pytest.approx(away, abs=0.02)


@pytest.mark.parametrize("batch", [4, 64])
def test_more_starts_than_a_batch_holds_come_out_the_same(problem, engine, evaluation, batch):
    seen = []
    found = simulate(engine, evaluation.starts, batch=batch, progress=lambda ended, all_: seen.append((ended, all_)))
    np.testing.assert_allclose(found.q, evaluation.outcomes.q, atol=1e-5)
    np.testing.assert_array_equal(found.status, evaluation.outcomes.status)
    assert seen[-1] == (42, 42) and sorted(seen) == seen


def test_a_batch_is_halved_until_it_fits(engine, monkeypatch):
    monkeypatch.setattr(Devices, "free_memory", lambda self: 2 * engine.bytes_needed(8))
    assert largest_batch(engine, 64) == 8
    monkeypatch.setattr(Devices, "free_memory", lambda self: 1)
    with pytest.raises(ConfigurationError, match="one start a device takes"):
        largest_batch(engine, 64)


def test_a_diverging_rollout_is_stopped_and_counted(problem, evaluation):
    steep = planar.planar(height=3e3)  # too stiff for this step
    engine = KinematicEngine(steep, replace(planar.CRITERIA, top_speed=50.0), dt=0.01, chunk=50)
    found = evaluate(engine, steep, planar.LIMITS, evaluation.starts[:8], batch=16)
    diverged = found.ends.kind == End.DIVERGED
    assert diverged.any()
    assert np.isinf(found.energy_increase[diverged]).all()
    assert np.isfinite(found.outcomes.track.energy).all()
    assert set(np.flatnonzero(diverged)) <= set(found.failing)
    again = replay(engine, steep, planar.LIMITS, evaluation.starts[np.argmax(diverged)])
    assert again.evaluation.ends.kind[0] == End.DIVERGED


@pytest.mark.parametrize(("processes", "devices"), [(1, 4), (2, 1)])
def test_devices_and_processes_find_the_same_as_one(evaluation, tmp_path, processes, devices):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        coordinator = f"127.0.0.1:{probe.getsockname()[1]}"
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={devices}"
    cache = jax.config.values["jax_compilation_cache_dir"] or ""
    environment = {**os.environ, "XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu", "JAX_COMPILATION_CACHE_DIR": cache}
    environment["PYTHONPATH"] = str(Path(__file__).parents[2])
    command = [sys.executable, str(_FILE), coordinator, str(processes)]
    children = [
        subprocess.Popen([*command, str(i), str(tmp_path / "out.json")], env=environment) for i in range(processes)
    ]
    assert [child.wait(timeout=240) for child in children] == [0] * processes
    found = json.loads((tmp_path / "out.json").read_text())
    assert found["devices"] == processes * devices
    np.testing.assert_allclose(found["q"], evaluation.outcomes.q, atol=1e-5)
    np.testing.assert_allclose(found["energy"], evaluation.outcomes.track.least, atol=1e-5)
    np.testing.assert_array_equal(found["kind"], evaluation.ends.kind)


def test_starts_depend_on_the_seed_and_their_index_alone(problem):
    few, many = sample_starts(problem, 5, seed=7), sample_starts(problem, 2000, seed=7)
    np.testing.assert_array_equal(few, many[:5])
    assert not np.array_equal(few, sample_starts(problem, 5, seed=8))
    assert (np.abs(many) <= 1.95).all() and np.abs(many).max() > 1.9
    assert (np.linalg.norm(many + 1.5, axis=1) > 0.3).all()  # not in the obstacle
    near = starts_around(problem, np.array([[0.5, 0.5], [-1.0, 1.0]]), 200, spread=0.1)
    to_each = np.abs(near[:, None] - np.array([[0.5, 0.5], [-1.0, 1.0]])).max(-1)
    assert (to_each.min(1) <= 0.1 + 1e-6).all() and (to_each.min(0) < 0.1).all()


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda p: check_starts(p, [[0, 0], [-1.5, -1.4]]), ConfigurationError, "start 1 is in collision, by 200 mm"),
        (lambda p: check_starts(p, [[0, 2.5]]), ConfigurationError, "start 0 .* outside the joint limits"),
        (lambda p: check_starts(p, [[0, np.nan]]), ConfigurationError, "start 0 .* outside the joint limits"),
        (lambda p: check_starts(p, np.zeros((2, 3))), ShapeError, r"starts has shape \(2, 3\), expected \[N, 2\]"),
        (lambda p: sample_starts(p, 0), ConfigurationError, "number of starts is 0"),
        (lambda p: sample_starts(p, 3, margin=2.0), ConfigurationError, "margin is 2.0, which leaves no room"),
        (lambda p: starts_around(p, [[-1.5, -1.5]], 3, spread=0.1), ConfigurationError, "none of .* is free"),
        (lambda p: starts_around(p, [[0.0, 0.0]], 3, spread=-1), ConfigurationError, "spread is -1"),
        (
            lambda p: StopCriteria(duration=0),
            ConfigurationError,
            "duration of StopCriteria is 0.0, expected a positive number",
        ),
    ],
)
def test_bad_starts_are_refused(problem, make, error, message):
    with pytest.raises(error, match=message):
        make(problem)


def test_rest_points_are_gathered_with_their_shares(evaluation):
    members = np.flatnonzero(evaluation.ends.kind == End.SPURIOUS)
    found = gather_rest_points(evaluation.outcomes.q, evaluation.ends.points, members, 42)
    assert 2 <= len(found) <= 4  # at x = -2, -1, 1, 2
    assert sum(p["share"] for p in found) == pytest.approx(len(members) / 42)
    assert all(found[i]["share"] >= found[i + 1]["share"] for i in range(len(found) - 1))
    assert found[0]["error_m"] == pytest.approx(1.0, abs=0.05)
    assert gather_rest_points(evaluation.outcomes.q, evaluation.ends.points, members[:0], 42) == []


def test_every_start_is_in_a_region_by_side_and_in_one_by_distance():
    rng = np.random.default_rng(0)
    hand, error = rng.normal(size=(50, 3)), rng.uniform(0, 2, 50)
    found = dict(regions(hand, error))
    assert np.all(sum(mask.astype(int) for mask in found.values()) == 2)
    assert found["hand left"][np.abs(hand[:, 1]) > np.abs(hand[:, 0])].sum() == found["hand left"].sum()


def test_a_rest_in_contact_is_told_apart(problem, evaluation):
    spurious = np.flatnonzero(evaluation.ends.kind == End.SPURIOUS)
    touching = np.zeros(42, np.int32)
    touching[spurious[0]] = 2
    outcomes = evaluation.outcomes._replace(track=evaluation.outcomes.track._replace(touching=touching))
    kind = classify_ends(problem, planar.LIMITS, outcomes).kind
    assert kind[spurious[0]] == End.HELD_BY_CONTACT
    assert (kind[spurious[1:]] == End.SPURIOUS).all()
    assert (outcomes.status[kind == End.SPURIOUS] == End.RESTING).all()
