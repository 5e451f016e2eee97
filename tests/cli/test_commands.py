"""The command line as a user calls it, on synthetic demonstrations."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import batched, pullback
from jaxrmp.cli import build_parser, main
from jaxrmp.cli._output import aligned, error_table
from jaxrmp.cli._overrides import parse_overrides
from jaxrmp.cli._reproduce import result_dict
from jaxrmp.learning import Reproduction, load_demonstrations, load_skill, save_demonstrations
from jaxrmp.leaves import Attractor, Damping, JointLimit
from jaxrmp.reports._page import records, settings, video
from jaxrmp.simulation import rollout

CONFIG = str(Path(__file__).parents[2] / "configs" / "drawer_closing.toml")
FAST = ["--method", "paper", "--metric.updates", "100", "--potential.widths", "[0.05]", "--potential.basin_starts=100"]


@pytest.fixture
def demos(drawer_demonstrations) -> str:
    return str(drawer_demonstrations)


@pytest.fixture
def learned(learned_drawer) -> Path:
    return learned_drawer


def test_learn_writes_skill_report_pictures_and_what_made_them(learned, demos):
    assert {p.name for p in learned.iterdir()} == {
        "drawer_closing.skill.npz",
        "learning_report.json",
        "made_by.json",
        "report.html",
        "learned.json",
        "figures",
    }
    made_by = json.loads((learned / "made_by.json").read_text())
    assert made_by["configuration"]["metric"]["updates"] == 100
    assert made_by["demonstrations"] == str(Path(demos).resolve())
    report = json.loads((learned / "learning_report.json").read_text())
    assert len(report["demonstrations"]) == 6
    assert report["reproduction"]["mean"]["goal_cm"] < 0.5 and report["validation"] is None
    told = json.loads((learned / "learned.json").read_text())
    assert Path(told.pop("skill_file")) == learned / "drawer_closing.skill.npz"
    assert told == report


def test_a_skill_is_learned_of_each_group(demos, tmp_path, capsys, monkeypatch):
    def learned(configuration, robot, demonstrations, out, arguments):
        return {"source": demonstrations.source, "folder": str(out)}

    monkeypatch.setattr("jaxrmp.cli._learn._learn", learned)  # what it does is tested above
    one = load_demonstrations(demos)[0]
    hump = np.eye(7)[0] * np.sin(np.pi * np.linspace(0, 1, len(one.time)))[:, None] ** 2
    moved = [replace(one, q=one.q + (aside + 0.01 * k) * hump) for k, aside in enumerate((0.2, -0.2, 0.2, -0.2, 0.6))]
    folder = tmp_path / "mixed"
    save_demonstrations(replace(load_demonstrations(demos), demonstrations=tuple(moved)), folder)
    learn = ["learn", CONFIG, "--demos", str(folder), "--groups", "--out", str(tmp_path / "out")]
    assert main([*learn, "--json", str(tmp_path / "all.json")]) == 0
    said = json.loads((tmp_path / "all.json").read_text())
    assert said["odd"] == [4] and "like no other: 4" in capsys.readouterr().err
    assert [group["demonstrations_of_all"] for group in said["groups"]] == [[0, 2], [1, 3]]
    for k, group in enumerate(said["groups"]):
        assert Path(group["folder"]) == tmp_path / "out" / f"group_{k}"
        np.testing.assert_array_equal(load_demonstrations(group["source"])[1].q, moved[k + 2].q)
    save_demonstrations(replace(load_demonstrations(folder), demonstrations=(moved[0], moved[4])), folder, True)
    assert main(learn) == 1 and "no groups to learn from" in capsys.readouterr().err


def test_demonstrations_without_the_configured_object_are_told_of(demos, tmp_path, capsys):
    door = CONFIG.replace("drawer_closing", "door_reaching")
    assert main(["learn", door, "--demos", demos, "--out", str(tmp_path), *FAST]) == 0
    assert "lives in the frame of 'world' and knows no 'door_handle'" in capsys.readouterr().err
    assert main(["run", str(tmp_path / "door_reaching.skill.npz"), "--scene", "door", "--trials", "1"]) == 1
    assert "scene 'door' tracks the object 'door_handle'" in capsys.readouterr().err


def test_what_was_learned_is_a_page_that_needs_nothing_else(learned):
    page = (learned / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"(src|href)=\"(?!data:)", page)
    assert page.count("data:image/png;base64,") == len(list((learned / "figures").glob("*.png"))) == 7
    report = json.loads((learned / "learning_report.json").read_text())
    assert report["self_clearance"]["distance"] > 0 and "are apart by" in report["self_clearance"]["text"]
    assert f"The robot and itself: {report['self_clearance']['text']}." in page
    mean = report["reproduction"]["mean"]
    assert f"<td>mean</td><td>{mean['dtw_cm']:.2f}</td>" in page
    assert "<td>metric: updates</td><td>100</td>" in page
    assert "Not validated: <code>jaxrmp learn --validate</code>" in page
    assert all(f"The learned field: {name}" in page for name in ("gripper", "left fingertip", "right fingertip"))


def test_validation_takes_three_demonstrations(demos, tmp_path, capsys):
    shown = load_demonstrations(demos)
    save_demonstrations(replace(shown, demonstrations=shown.demonstrations[:2]), tmp_path / "two")
    learn = ["learn", CONFIG, "--demos", str(tmp_path / "two"), "--validate", "--out", str(tmp_path / "out")]
    assert main(learn) == 1 and "takes three at least" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_reproduce_prints_and_writes_the_same_errors(learned, demos, tmp_path, capsys):
    skill, errors, rollouts = str(learned / "drawer_closing.skill.npz"), tmp_path / "e.json", tmp_path / "r.npz"
    command = ["reproduce", skill, "--demos", demos, "--json", str(errors), "--save", str(rollouts)]
    assert main([*command, "--figures", str(tmp_path / "figures")]) == 0
    result = json.loads(errors.read_text())
    turns = {"position_percent", "turn_deg", "goal_turn_deg"}
    keys = {"demo", "dtw_cm", "frechet_cm", "goal_cm", "energy_increase", "limit_margin_rad", "time_aligned_cm"} | turns
    assert all(result["mean"][name] is None for name in turns)  # points tell the paper's method of none
    assert [set(e) for e in result["per_demo"]] == [keys | {"rests_away_from"}] * 6
    assert [e["rests_away_from"] for e in result["per_demo"]] == [[]] * 6
    assert set(result["mean"]) == keys - {"demo"}
    assert result["mean"]["dtw_cm"] == pytest.approx(np.mean([e["dtw_cm"] for e in result["per_demo"]]))
    table = capsys.readouterr().out.splitlines()
    assert f"measured on {Path(demos).resolve()}" in table
    assert result["learned_from"] == result["measured_on"] == str(Path(demos).resolve())
    assert table[-1].split()[:2] == ["mean", f"{result['mean']['dtw_cm']:.2f}"]
    with np.load(rollouts) as saved:
        assert saved["q_5"].shape == saved["qd_5"].shape == (4001, 7)
        assert saved["time_5"][-1] == pytest.approx(20.0)
    assert list((tmp_path / "figures").glob("*.png"))


def test_goals_that_the_arm_rests_away_from_are_named(learned):
    skill = load_skill(learned / "drawer_closing.skill.npz")
    limits = JointLimit(-np.ones(3, np.float32), np.ones(3, np.float32))

    def run(goals):
        pull = pullback(lambda q: q - goals, batched(*(Attractor(np.zeros(3), sharpness=5.0, gain=3.0),) * 3))
        return rollout(pull + limits + Damping(1e-3, 4.0), jnp.zeros(3), duration=10.0, dt=0.01)

    near = np.tile([0.2, -0.1, 0.3], (3, 1)).astype(np.float32)
    far = near + [[0.0, 0, 0], [0.0, 0, 0], [1.5, 0, 0]]
    paths = jax.jit(jax.vmap(run))(jnp.asarray(np.stack([near, far]), jnp.float32))
    numbers = dict.fromkeys(("dtw_cm", "frechet_cm", "goal_cm", "energy_increase", "limit_margin_rad"), 0.0)
    result = result_dict(Reproduction(paths, np.zeros((2, 1, 3, 3)), (numbers, numbers)), skill, "elsewhere")
    assert [e["rests_away_from"] for e in result["per_demo"]] == [[], list(skill.subtasks)]
    last = error_table(result).splitlines()[-1]
    assert last == f"demo 1 comes to rest more than 1 cm away from the goal of {', '.join(skill.subtasks)}"


def test_columns_that_say_nothing_are_left_out_of_tables():
    rows = [["0", "-", "1.25", "fell over"], ["10", "-", "-", "arrived"]]
    assert aligned(["trial", "angle", "error_mm", "reason"], rows, of_words=1) == [
        "trial  error_mm  reason",
        "0          1.25  fell over",
        "10            -  arrived",
    ]
    page = records(rows, {"trial": lambda r: r[0], "empty": lambda r: "", "why": lambda r: r[3]})
    assert "<th>why</th>" in page and "empty" not in page and page.count("<td>") == 4


def test_settings_are_told_in_words_and_a_video_is_in_the_page(tmp_path):
    said = {
        "configuration": {"policy": {"damping_rate": 40.0, "tempo": None}, "subtasks": [{"frame": "hand"}], "on": True},
        "versions": {"jax": "1.2", "start_margin_rad": 0.05},
    }
    page = settings(said, ("configuration", "versions"))
    cells = re.findall("<td>(.*?)</td>", page)
    assert cells[:6] == ["policy: damping rate", "40", "subtasks 1: frame", "hand", "on", "yes"]
    assert cells[6:] == ["jax", "1.2", "start margin, rad", "0.05"]
    (tmp_path / "run.mp4").write_bytes(b"film")
    assert 'src="data:video/mp4;base64,ZmlsbQ=="' in video(tmp_path / "run.mp4", "A film.")


def test_a_synthetic_source_can_be_named(learned, capsys):
    skill = str(learned / "drawer_closing.skill.npz")
    assert main(["reproduce", skill, "--demos", "synthetic:drawer_closing", "--duration", "1"]) == 0
    printed = capsys.readouterr().out
    assert "measured on synthetic:drawer_closing" in printed
    assert "note: learned from" in printed


def test_a_skill_is_measured_on_what_it_was_learned_from_unless_told_otherwise(learned, demos, capsys):
    skill = str(learned / "drawer_closing.skill.npz")
    assert main(["reproduce", skill, "--duration", "1"]) == 0
    printed = capsys.readouterr().out
    assert f"measured on {Path(demos).resolve()}" in printed
    assert "note:" not in printed


def test_run_closes_the_drawer_in_physics(learned, demos, tmp_path, capsys):
    skill, file = str(learned / "drawer_closing.skill.npz"), tmp_path / "run.json"
    command = ["run", skill, "--scene", "drawer", "--trials", "7"]
    assert main([*command, "--json", str(file)]) == 0
    report = json.loads(file.read_text())
    assert (report["scene"], report["trials"]) == ("drawer", 7)
    assert report["successes"] == sum(t["success"] for t in report["per_trial"]) >= 6
    keys = {"success", "reason", "final_error_m", "min_clearance_m", "saturated", "diverged"}
    assert all(keys <= set(t) for t in report["per_trial"])
    assert all(t["final_error_m"] < 0.005 for t in report["per_trial"] if t["success"])
    printed = capsys.readouterr()
    assert f"{report['successes']} of 7 trials succeeded in scene drawer" in printed.out
    assert "running ..." in printed.err
    page = file.with_suffix(".html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 2 and not re.search(r"(src|href)=\"(?!data:)", page)
    assert f"{report['successes']} of 7 trials succeeded" in page and "<td>seed</td><td>0</td>" in page
    shown, paths = load_demonstrations(demos), [trial["path"] for trial in report["per_trial"]]
    assert [path and path["demonstration"] for path in paths] == [*range(len(shown)), None]  # then a variation
    assert all(0 < path["dtw_cm"] < path["frechet_cm"] < 8 for path in paths[:-1])
    mean = np.mean([path["dtw_cm"] for path in paths[:-1]])
    assert report["path"]["dtw_cm"] == pytest.approx(mean) and report["trials_compared"] == len(shown)
    assert f"their ways are {mean:.2f} cm" in printed.out and f"<td>5</td><td>{paths[5]['dtw_cm']:.2f}</td>" in page
    assert main([*command, "--quiet", "--trial", "6", "--json", str(file)]) == 0
    assert capsys.readouterr().err == ""
    (replayed,) = json.loads(file.read_text())["per_trial"]
    assert replayed["trial"] == 6 and replayed["path"] is None
    assert replayed["time_s"] == pytest.approx(report["per_trial"][6]["time_s"], abs=0.1)


def test_run_looks_ahead_for_a_way_round_obstacles(learned, tmp_path, capsys):
    skill, file = str(learned / "drawer_closing.skill.npz"), tmp_path / "run.json"
    command = ["run", skill, "--trials", "2", "--limit", "0.5", "--detour", "--json", str(file), "--scene"]
    assert main([*command, "drawer_obstacle"]) == 0
    detours = json.loads(file.read_text())["detours"]
    assert len(detours) == 2 and all(len(found["lean_m"]) == 3 and found["strength_n"] >= 0 for found in detours)
    assert all(0 < found["clearance_m"] < 1 and 0 < found["left_m"] < 1 for found in detours)
    assert main([*command, "drawer"]) == 0
    assert json.loads(file.read_text())["detours"] is None
    assert "scene 'drawer' tells the policy of no obstacles" in capsys.readouterr().err


def test_a_trial_that_fails_is_an_error_if_that_is_asked_for(learned, capsys):
    command = ["run", str(learned / "drawer_closing.skill.npz"), "--scene", "drawer", "--trials", "1", "--limit", "0.3"]
    assert main(command) == 0
    assert main([*command, "--strict"]) == 1
    printed = capsys.readouterr()
    assert "0 of 1 trials succeeded" in printed.out
    assert "--strict: 1 of 1 trials did not succeed: [0]. Replay one with --trial K." in printed.err


def test_what_cannot_be_written_or_read_is_said_before_anything_runs(learned, tmp_path, capsys):
    skill = str(learned / "drawer_closing.skill.npz")
    assert main(["run", skill, "--scene", "drawer", "--video", str(tmp_path / "run.avi")]) == 1
    assert "run.avi': expected a name that ends in .mp4 or .gif" in capsys.readouterr().err
    assert main(["reproduce", str(CONFIG)]) == 1
    error = capsys.readouterr().err
    assert "is no skill file, or is damaged: it is no NPZ archive" in error and "pickle" not in error


def test_run_refuses_a_scene_without_the_skills_object(learned, capsys):
    skill = str(learned / "drawer_closing.skill.npz")
    assert main(["run", skill, "--scene", "door"]) == 1
    assert "scene 'door' tracks the object 'door_handle'" in capsys.readouterr().err
    assert main(["run", skill, "--scene", "drawer", "--trials", "2", "--trial", "2"]) == 1
    assert "there are trials 0 to 1" in capsys.readouterr().err


def test_a_data_folder_without_the_recordings_is_an_error(monkeypatch, capsys, tmp_path):
    monkeypatch.setenv("JAXRMP_DATA", str(tmp_path / "nowhere"))
    assert main(["learn", CONFIG]) == 1
    assert "JAXRMP_DATA is set, but there is no folder" in capsys.readouterr().err


def test_an_output_folder_that_cannot_be_is_said_before_learning(demos, capsys, tmp_path):
    (tmp_path / "file").write_text("")
    assert main(["learn", CONFIG, "--demos", demos, "--out", str(tmp_path / "file")]) == 1
    printed = capsys.readouterr().err
    assert "file' is a file: give a folder" in printed
    assert "potentials" not in printed


def test_help_and_version_need_no_optional_package():
    code = (
        "import sys; sys.modules.update(dict.fromkeys(['flax', 'optax', 'cvxpy', 'mujoco', 'matplotlib', 'scipy']))\n"
    )
    code += "from jaxrmp.cli import main\nassert main(['learn', 'x.toml']) == 1\nmain(['--version'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert done.stdout.startswith("jaxrmp ")
    assert "is needed for this and is not installed: pip install 'jaxrmp[learning]'" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["learn", "nowhere.toml"], "cannot read configuration 'nowhere.toml'"),
        (["learn", CONFIG, "--demos", "nowhere"], "nowhere"),
        (["learn", CONFIG, "--metric.update", "5"], "Did you mean 'updates'"),
        (["learn", CONFIG, "--metric.updates"], "--metric.updates has no value"),
        (["learn", CONFIG, "--robot", "nowhere.urdf"], "nowhere.urdf"),
        (["learn", CONFIG, "--demos", "synthetic:drawer_closin"], "Did you mean 'drawer_closing'"),
        (["reproduce", "nowhere.npz"], "there is no skill file 'nowhere.npz'"),
        (["demonstrate", "dancing", "out"], "dancing"),
    ],
)
def test_mistakes_are_explained_without_a_traceback(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 1
    printed = capsys.readouterr()
    assert message in printed.err
    assert "Traceback" not in printed.err
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_frame_is_named_with_the_nearest(demos, capsys, tmp_path):
    out = ["--out", str(tmp_path)]
    assert main(["learn", CONFIG, "--demos", demos, *out, "--subtasks.gripper.frame", "panda_lnk7"]) == 1
    assert "Did you mean 'panda_link7'" in capsys.readouterr().err


def test_wrong_usage_exits_with_two(capsys):
    for arguments in ([], ["lern"], ["reproduce", "x", "--jsn", "y"]):
        with pytest.raises(SystemExit) as stop:
            main(arguments)
        assert stop.value.code == 2


def test_help_fits_a_screen_and_every_command_has_an_example(capsys):
    assert len(build_parser().format_help().splitlines()) <= 28
    commands = re.findall(r"^    (\w+)", build_parser().format_help(), re.MULTILINE)
    assert len(commands) >= 6
    for command in commands:
        with pytest.raises(SystemExit):
            main([command, "--help"])
        assert f"example: jaxrmp {command}" in capsys.readouterr().out


def test_overrides_are_read_as_toml_or_else_as_text():
    assert parse_overrides(["--a.b", "1e-3", "--c=[1, 2]", "--d", "panda", "--e", "true"]) == {
        "a.b": 1e-3,
        "c": [1, 2],
        "d": "panda",
        "e": True,
    }


def test_interrupted_learning_leaves_no_half_written_file(demos, tmp_path):
    out = tmp_path / "out"
    environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": str(jax.config.jax_compilation_cache_dir or tmp_path)}
    # A shell's background jobs ignore SIGINT, and a child inherits that: give it the foreground's handler.
    program = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
    program += "from jaxrmp.cli import main; sys.exit(main())"
    command = [sys.executable, "-c", program, "learn", CONFIG, "--demos", demos, "--out", str(out)]
    command += [
        "--method",
        "paper",
        "--metric.updates",
        "1000000",
        "--potential.widths",
        "[0.05]",
        "--potential.basin_starts",
        "100",
    ]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
    assert process.stderr is not None
    for line in process.stderr:
        if line.startswith("metrics"):
            break
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    rest = process.stderr.read()
    assert process.wait(timeout=120) == 130
    assert "interrupted" in rest
    assert "Traceback" not in rest
    assert not out.exists() or list(out.rglob("*")) == []
