"""Every benchmark runs, in its quick form, through the path that the long one takes; no test looks at a time."""

import json
import math
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks import _bars, _children, control_loop, kinematics, throughput
from benchmarks.__main__ import run
from benchmarks._report import write_json
from benchmarks._urdf import urdf_chain
from jaxrmp import acceleration
from jaxrmp.kinematics import forward_kinematics, load_robot_from_string, panda
from jaxrmp.leaves import Damping


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory):
    """An empty working folder, where the quick skill is learned once for all tests of this file."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("benchmarks"))
        yield Path.cwd()


def rows_of(name: str, folder: Path) -> dict[str, dict]:
    run(name, folder / f"{name}.json", quick=True)
    return checked(folder / f"{name}.json")


def checked(file: Path) -> dict[str, dict]:
    content = json.loads(file.read_text())
    assert {"machine", "versions", "date", "load_average", "seconds", "rows"} <= set(content)
    assert content["quick"]
    assert content["versions"]["jax"]
    for row in content["rows"]:
        assert row["device"]
        assert all(math.isfinite(value) for value in row.values() if isinstance(value, float)), row
    return {row["name"]: row for row in content["rows"]}


def test_latency_as_a_command(folder):
    command = [sys.executable, "-m", "benchmarks", "latency", "--quick", "--json", "latency.json"]
    printed = subprocess.run(
        command, cwd=folder, env=_children.environment_of(), check=True, capture_output=True, text=True
    )
    rows = checked(folder / "latency.json")
    assert "panda_24_pairs" in printed.stdout
    dispatch = {f"dispatch_{what}" for what in ("of_state_alone", "with_what_moves", "with_whole_tree")}
    assert {"panda_24_pairs", *dispatch} == set(rows)
    row = rows["panda_24_pairs"]
    assert 0 < row["median_us"] <= row["p99_us"] <= row["p999_us"]
    assert all(row[name] > 0 for name in ("whole_tree_us", "fixed_us", "batch_1024_us"))
    assert (folder / "latency.png").stat().st_size > 1000


def test_nothing_is_traced_again_while_all_moves(folder):
    row = rows_of("control_loop", folder)["moving_goal_door_obstacles"]
    assert row["steps"] == 100
    assert row["retraces"] == 0


def test_retraces_are_counted():
    def another_tree_every_step(t):
        return sum((Damping() for _ in range(round(1000 * t))), Damping())

    assert control_loop.run(another_tree_every_step, 2)["retraces"] == 1


def test_throughput_of_batches(folder):
    rows = rows_of("throughput", folder)
    assert rows["batch, panda_24_pairs"]["per_second"] > 0
    assert math.isfinite(rows["growth: batch, panda_24_pairs"]["exponent"])


@pytest.mark.parametrize(("family", "make", "sizes"), throughput.FAMILIES)
def test_families_are_policies_of_every_size(family, make, sizes):
    for size in (sizes[0], sizes[-1]):
        tree = make(size)
        n = size if sizes is throughput.JOINTS else 7
        assert jax.eval_shape(acceleration, tree, jnp.zeros(n), jnp.zeros(n)).shape == (n,)
    if make is throughput.separate_leaves:
        assert len(list(tree.leaves())) == size + 2


@pytest.mark.parametrize(("power", "verdict"), [(0.9, "no worse than linear"), (1.5, "worse than linear")])
def test_growth_is_fitted_from_the_second_size_on(power, verdict):
    taken = {1: 1e9, **{size: 3.0 * size**power for size in (2, 4, 8, 16)}}
    row = throughput._growth("family", taken)
    assert row["exponent"] == pytest.approx(power)
    assert row["steepest_step"] == pytest.approx(power)
    assert row["verdict"] == verdict


def test_separate_leaves_and_a_batched_one_are_the_same_policy():
    q, qd = jnp.linspace(-0.5, 0.5, 7), jnp.linspace(0.3, -0.3, 7)
    trees = throughput.separate_leaves(2), throughput.batched_leaves(2)
    separate, together = jax.jit(lambda q, qd: [tree(q, qd) for tree in trees])(q, qd)
    np.testing.assert_allclose(separate.M, together.M, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(separate.f, together.f, rtol=1e-4, atol=1e-5)


def test_kinematics_agree_and_are_compared(folder):
    pytest.importorskip("torch")
    rows = rows_of("kinematics", folder)
    assert {f"{name} fk+jacobian" for name in ("jaxrmp", "pytorch-kinematics", "mjx")} <= set(rows)
    assert all(row["batch_us"] > 0 and row["times_ours"] > 0 for row in rows.values())


def test_kinematics_that_disagree_are_not_compared():
    ours = kinematics.ours()["fk"]
    with pytest.raises(RuntimeError, match="a peer fk differs from jaxrmp by 2.0e-05, more than 1e-05"):
        kinematics._check("a peer fk", lambda q: ours(q) + 2e-5, ours)


def test_the_urdf_for_peers_is_the_same_robot():
    robot = panda()
    again = load_robot_from_string(urdf_chain(robot, "panda_hand"))
    assert again.joint_names == robot.joint_names
    np.testing.assert_allclose(again.lower, robot.lower)
    q = jnp.linspace(-0.5, 0.5, 7)
    T = [forward_kinematics(r, q, "panda_hand") for r in (again, robot)]
    np.testing.assert_allclose(T[0], T[1], atol=1e-6)


def test_training_by_us_and_by_pytorch_is_the_same(folder):
    pytest.importorskip("torch")
    rows = rows_of("learning", folder)
    ours, theirs = rows["metric loop, jaxrmp"], rows["metric loop, torch, threads: 1"]
    assert ours["updates"] == 20
    assert ours["first_loss"] == pytest.approx(theirs["first_loss"], abs=1e-5)
    assert ours["last_loss"] == pytest.approx(theirs["last_loss"], abs=1e-4)
    assert ours["last_loss"] < 0.8 * ours["first_loss"]
    assert rows["convex program of one potential"]["step_s"] > 0


def test_compilation_is_measured_in_fresh_processes(folder):
    rows = rows_of("compilation", folder)
    cold, cached = rows["panda_24_pairs, cold"], rows["panda_24_pairs, cached"]
    assert cold["compile_s"] > cold["trace_s"] > 0
    assert cached["program_mb"] == cold["program_mb"] > 0  # nothing was added to the cache


def test_peers_are_run_or_quoted(folder):
    rows = rows_of("peers", folder)
    assert rows["jaxrmp"]["median_us"] > 0
    assert rows["RMP2, tensorflow-cpu 2.21"]["measured"] == "2026-11"
    assert rows["RMP2, tensorflow-cpu 2.21"]["median_us"] == 23_000


def test_roofline_adds_up(folder):
    rows = rows_of("roofline", folder)
    parts = [row for name, row in rows.items() if name.startswith("by hand, ") and name != "by hand, all"]
    assert rows["by hand, all"]["operations"] == sum(row["operations"] for row in parts)
    assert rows["by hand, all"]["limit_us"] == max(rows["by hand, all"][f"{k}_us"] for k in ("operations", "bytes"))
    # The compiler's count holds what is computed twice, so it cannot be below what is needed.
    assert rows["as compiled by XLA, all"]["operations"] > rows["by hand, all"]["operations"]


def test_rollouts_in_both_engines(folder):
    rows = rows_of("rollouts", folder)
    assert rows["mujoco"]["running"] == rows["mujoco"]["batch"]
    assert rows["mujoco.rollout, no policy"]["steps_per_s"] > 0
    assert rows["stage: kinematics"]["us_until_here"] > 0


def test_a_child_that_fails_says_why():
    with pytest.raises(RuntimeError, match="No module named 'benchmarks.nothing'"):
        _children.in_child("benchmarks.nothing:rows")


def test_bars_are_judged_by_the_json(tmp_path):
    latency = [{"name": "panda_24_pairs", "median_us": 44.0, "p999_us": 301.0, "batch_1024_us": 2.0}]
    write_json(latency, tmp_path / "latency.json", quick=True, seconds=1.0)
    lines = _bars.report(tmp_path).splitlines()
    assert "quick" in lines[0]
    verdicts = {line[:40].strip(): line.split()[-1] for line in lines}
    assert verdicts["24 pairs, one call, median"] == "met"
    assert verdicts["24 pairs, one call, p99.9"] == "MISSED"
    assert verdicts["Lula Franka, one call, median"] == "measured"  # not measured


def test_numbers_of_numpy_and_none_at_all_are_written(tmp_path):
    row = {"name": "door", "lost": np.isfinite([1.0, 2.0]).sum(), "found_s": np.inf, "ms": np.float32(0.5)}
    write_json([row], tmp_path / "rows.json", quick=True, seconds=1.0)
    (read,) = json.loads((tmp_path / "rows.json").read_text())["rows"]
    assert read == {"name": "door", "lost": 2, "found_s": None, "ms": 0.5}


def test_documents_are_filled_from_the_json(tmp_path):
    text = "Before.\n<!-- table: latency -->\nold\n<!-- end -->\nAfter.\n"
    with pytest.raises(SystemExit, match="latency.json is not there: python -m benchmarks latency"):
        _bars.fill(text, tmp_path)
    rows = [{"name": "panda_24_pairs", "median_us": 44.0}]
    write_json(rows, tmp_path / "latency.json", quick=True, seconds=1.0)
    with pytest.raises(SystemExit, match="quick run"):
        _bars.fill(text, tmp_path)
    write_json(rows, tmp_path / "latency.json", quick=False, seconds=1.0)
    filled = _bars.fill(text, tmp_path)
    assert "| panda_24_pairs | 44 |" in filled
    assert "old" not in filled
    assert _bars.fill(filled, tmp_path) == filled
