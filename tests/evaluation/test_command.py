"""`jaxrmp evaluate` as a user calls it, on a small skill."""

import base64
import io
import json
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.image import imread

from jaxrmp import ConfigurationError
from jaxrmp.cli import main
from jaxrmp.cli._evaluate import _rate, summary
from jaxrmp.evaluation import KINDS, check_starts, sample_starts, scene_problem, skill_problem
from jaxrmp.evaluation._finished import _key
from jaxrmp.kinematics import panda
from jaxrmp.learning import load_skill, save_skill
from jaxrmp.scenes import arm_alone, scene
from jaxrmp.simulation import MujocoEngine, StopCriteria
from jaxrmp.visualization._style import DPI, WIDTH

from .reaching import HOME, reaching_skill

FAST = ["--dt", "0.002", "--batch", "16", "--duration", "20", "--seed", "4"]


@pytest.fixture(scope="module")
def skill_file(tmp_path_factory):
    return str(save_skill(reaching_skill(), tmp_path_factory.mktemp("skill") / "reach.skill.npz"))


@pytest.fixture(scope="module")
def report(skill_file, tmp_path_factory):
    out = tmp_path_factory.mktemp("report") / "report.json"
    ends = out.with_suffix(".npz")
    command = ["evaluate", skill_file, "--starts", "12", *FAST, "--json", str(out)]
    assert main([*command, "--save", str(ends)]) == 0
    with np.load(ends) as saved:
        return json.loads(out.read_text()), out.with_suffix(".html").read_text(), dict(saved)


def test_the_report_holds_what_a_reviewer_asks_for(report):
    found = report[0]
    assert found["starts"] == 12 and found["non_finite"] == 0
    shares = ("converged", "stopped_at_limit", "held_by_contact", "spurious", "unfinished", "diverged")
    assert sum(found[name] for name in shares) == pytest.approx(1.0)
    assert found["converged"] > 0.5
    assert 0 <= found["max_energy_increase"] <= 1e-3
    assert isinstance(found["spurious_rest_points"], list)
    assert -0.3 < found["min_clearance_m"] < 0.5
    assert sum(r["starts"] for r in found["regions"]) == 24  # by side, and by distance
    assert found["failing_starts"] == len(found["failing"])
    settings = found["settings"]
    assert settings["physics"] == "kinematic" and settings["seed"] == 4
    assert settings["rest_seconds"] == 1.0 and not [name for name in settings if name.startswith("_")]


def test_every_start_and_end_can_be_saved(report):
    found, _, saved = report
    assert saved["starts"].shape == saved["q"].shape == (12, 7)
    assert (saved["kind"] == 1).mean() == pytest.approx(found["converged"])
    assert saved["error"] == pytest.approx(np.linalg.norm(saved["points"], axis=-1).max(-1))
    assert saved["energy_increase"].max() == pytest.approx(found["max_energy_increase"])


def test_what_was_not_watched_is_not_called_clear(report):
    found, *_ = report
    assert "not watched" not in summary(found)
    blind = found | {"min_clearance_m": np.inf, "starts_that_touched": None}
    assert "smallest clearance      not watched" in summary(blind)
    assert "not watched (0 starts touched)" in summary(blind | {"starts_that_touched": 0})  # contacts in physics are
    assert "(1 start touched)" in summary(found | {"starts_that_touched": 1})


def test_what_is_kept_belongs_to_the_physics_that_it_came_from(skill_file):
    skill, robot, starts = load_skill(skill_file), panda(), np.zeros((2, 7))
    problem, place = skill_problem(skill, robot), arm_alone("panda", robot)
    engine = MujocoEngine(place, problem, StopCriteria())
    key = _key(engine, problem, starts)
    assert _key(MujocoEngine(arm_alone("panda", robot), problem, StopCriteria()), problem, starts) == key
    place.model.dof_damping[:] += 1.0
    assert _key(engine, problem, starts) != key


def test_the_time_left_does_not_count_the_compiling():
    times, said = iter([0.0, 20.0, 40.0, 50.0, 60.0]), []
    progress = _rate(lambda step, share: said.append(step), lambda: next(times))
    for ended in (5, 5, 6, 26, 100):  # of which five were there already
        progress(ended, 100)
    assert said == [
        *["5 of 100 ended"] * 2,
        "6 of 100 ended",
        "26 of 100 ended, 2/s, 37 s left",
        "100 of 100 ended, 4.7/s, 0 s left",
    ]


def test_a_replay_leaves_alone_what_is_kept_of_an_evaluation(skill_file, tmp_path, capsys):
    report, kept = tmp_path / "r.json", tmp_path / "r.finished.npz"
    kept.write_bytes(b"the work of a night")
    command = ["evaluate", skill_file, "--replay", "1", *FAST, "--json", str(report)]
    assert main(command) == 0
    assert json.loads(report.read_text())["start"] == 1 and kept.read_bytes() == b"the work of a night"
    capsys.readouterr()
    assert main([*command, "--resume"]) == 1
    assert "--replay runs one of them" in capsys.readouterr().err


def test_the_whole_arm_is_evaluated(report):
    leaves = report[0]["settings"]["leaves"]
    assert {"self_collision", "joint_velocity_limit", "hand_orientation", "joint_limit"} < set(leaves)
    assert report[0]["starts_that_touched"] == 0 and report[0]["max_joint_speed_rad_s"] < 2.61


def test_stability_is_told_as_mathematics(report):
    stability = report[0]["stability"]
    (hand,) = stability["subtasks"]
    assert hand["metric"]["positive_definite_share"] == 1.0 and hand["metric"]["least_eigenvalue"] > 0.5
    assert hand["goal"]["slope"] < 1e-3 and min(hand["goal"]["hessian_eigenvalues"]) > 1
    nearest = hand["stationary_points"][0]
    assert nearest["kind"] == "minimum" and nearest["distance_m"] < 1e-3
    assert stability["certificate"]["max_residual"] < 1e-3
    assert stability["certificate"]["uncertified_leaves"] == []


def test_the_page_needs_nothing_else(report):
    page = report[1]
    assert page.count("data:image/png;base64,") == 4
    assert not re.search(r"(src|href)=\"(?!data:)", page)
    for picture in re.findall(r"data:image/png;base64,([^\"]+)", page):
        assert imread(io.BytesIO(base64.b64decode(picture))).shape[1] == WIDTH * DPI
    assert "By start region" in page and f"{100 * report[0]['converged']:.2f} %" in page


def test_regions_have_no_column_of_an_end_that_no_start_had(report):
    found, page = report[:2]
    heads = re.findall("<th>(.*?)</th>", page.split("By start region")[1].split("</table>")[0])
    had = {name.replace("_", " ") for name in KINDS.values() if found[name]}
    assert had and len(had) < len(KINDS)
    assert set(heads) == {"region", "starts", "median time, s"} | had


def test_a_start_is_replayed_by_its_index(skill_file, report, tmp_path):
    out, states = tmp_path / "one.json", tmp_path / "one.npz"
    command = ["evaluate", skill_file, *FAST, "--replay", "5", "--json", str(out), "--save", str(states)]
    assert main(command) == 0
    again = json.loads(out.read_text())
    assert again["start"] == 5
    failing = {f["start"]: f for f in report[0]["failing"]}
    assert (again["end"] in ("converged", "stopped_at_limit")) == (5 not in failing)
    with np.load(states) as saved:
        np.testing.assert_allclose(saved["q"][0], again["q_start"], atol=1e-6)
        assert len(saved["time"]) == len(saved["qd"]) and (np.diff(saved["time"]) >= 0).all()


def test_strict_fails_for_a_rollout_that_does_not_end_well(skill_file, capsys):
    command = ["evaluate", skill_file, "--starts", "4", *FAST, "--duration", "0.5"]
    assert main(command) == 0
    assert main([*command, "--strict"]) == 1
    assert re.search(r"--strict: \d of 4 starts neither converged .* --replay INDEX", capsys.readouterr().err)


def test_a_start_in_collision_is_refused(skill_file, tmp_path, capsys):
    folded = np.array([[0.0, 1.7, 0.0, -3.0, 0.0, 3.7, 0.0], HOME], np.float32)
    np.save(tmp_path / "starts.npy", folded)
    command = ["evaluate", skill_file, "--start-file", str(tmp_path / "starts.npy"), *FAST]
    assert main(command) == 1
    assert re.search(r"start \d is in collision, by \d+ mm", capsys.readouterr().err)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--starts", "0"], "number of starts is 0"),
        (["--scene", "drawr"], "Did you mean 'drawer'"),
        (["--scene", "door"], "use --scene drawer"),
        (["--dt", "0"], "--dt 0.0: expected more than 0"),
        (["--replay", "-1"], "--replay -1: expected the index of a start"),
        (["--batch", "0"], "batch is 0, expected at least 1"),
        (["--physics", "mujoco", "--dt", "0.01"], "physics runs in steps of 0.001 s"),
        (["--process", "0"], "--process needs --coordinator"),
        (["--start-file", "nowhere.npy"], "nowhere.npy"),
    ],
)
def test_bad_arguments_are_explained(skill_file, arguments, message, capsys):
    assert main(["evaluate", skill_file, *arguments]) == 1
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("name", ["drawer_obstacle", "door"])
def test_starts_that_are_free_by_spheres_touch_nothing_in_the_scene(skill_file, name):
    place = scene(name)
    problem = scene_problem(load_skill(skill_file), place.robot, place)
    for q in sample_starts(problem, 30, seed=1):
        place.data(q)  # raises for a start in collision
    pressed = next(q for q in np.random.default_rng(0).uniform(-1, 1, (10000, 7)) * 2.5 if touches(place, q))
    with pytest.raises(ConfigurationError, match="is in collision"):
        check_starts(problem, np.clip(pressed, problem.lower, problem.upper)[None])


def touches(place, q):
    """Whether the arm is in collision at q, held within its limits."""
    try:
        place.data(np.clip(q, place.robot.lower, place.robot.upper))
    except ConfigurationError:
        return True
    return False


def test_the_skill_comes_back_with_its_support(skill_file):
    support = load_skill(skill_file).learned.cholesky_of.support
    on_path, away = support.anchors[0, 0], support.anchors[0, 0] + jnp.array([0.0, 0.5, 0.0])
    one = jax.tree.map(lambda a: a[0], support)
    assert float(one(on_path)) > 0.8 and float(one(away)) < 0.01
