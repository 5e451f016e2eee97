"""The bars of the experiments in physics, by the command line that anyone can call.

Skills are learned into out/benchmarks where they are not there yet, from the recordings (with `JAXRMP_DATA` set) and
from the synthetic demonstrations. `times_kinematic`: the path's error (DTW), in the mean over trials that start as a
demonstration did, over that of kinematic rollouts of the skill's own tree to the same targets.
"""

import json
import os
from collections.abc import Callable
from functools import cache
from typing import Any

from jaxrmp.cli import main
from jaxrmp.learning import load_skill, prepare, reproduce

from ._report import FOLDER
from ._skills import demonstrations, skill_file

_TRACKER = ["--displace", "--tracker-delay", "0.1", "--tracker-dropouts", "0.1"]
_HELD = ["--learned-rate", "50"]

# Name, task, arguments of `jaxrmp run`, how many of the first trials are judged by another row.
_BARS: list[tuple[str, str, list[str], int]] = [
    ("drawer, demonstrated starts", "drawer_closing", ["--scene", "drawer"], 0),
    ("drawer, 50 starts within 0.15 rad", "drawer_closing", ["--scene", "drawer", "--trials", "56"], 6),
    ("the same, learned leaves at 50 Hz", "drawer_closing", ["--scene", "drawer", "--trials", "56", *_HELD], 6),
    ("drawer behind the cylinder", "drawer_closing", ["--scene", "drawer_obstacle"], 0),
    ("cylinder at 20 places", "drawer_closing", ["--scene", "drawer_obstacle", "--trials", "126"], 6),
    ("door, demonstrated poses", "door_reaching", ["--scene", "door"], 0),
    ("door at 50 poses", "door_reaching", ["--scene", "door", "--trials", "56"], 6),
    ("the same, learned leaves at 50 Hz", "door_reaching", ["--scene", "door", "--trials", "56", *_HELD], 6),
    ("door displaced during execution", "door_reaching", ["--scene", "door", "--trials", "50", *_TRACKER], 0),
    (
        "the same, tracker off by 5 mm an axis",
        "door_reaching",
        ["--scene", "door", "--trials", "50", *_TRACKER, "--tracker-bias", "0.005"],
        0,
    ),
]


def rows() -> list[dict[str, Any]]:
    """One row a bar and source: successes, trials, least clearance, mean time, how often torque limits cut in."""
    sources = ["synthetic"] + (["recordings"] if os.environ.get("JAXRMP_DATA") else [])
    return [row(source, *bar) for bar in _BARS for source in sources]


def row(source: str, name: str, task: str, arguments: list[str], skipped: int) -> dict[str, Any]:
    """A bar by `jaxrmp run`; trials before `skipped` are judged by another row. With a camera, what it saw."""
    skill = skill_file(task, source)
    file = FOLDER / "run.json"
    if main(["run", str(skill), *arguments, "--json", str(file)]):
        raise SystemExit(f"jaxrmp run {skill} {' '.join(arguments)} failed")
    result = json.loads(file.read_text())
    trials, path = result["per_trial"][skipped:], result["path"] if not skipped else None
    return {
        "name": name,
        "source": source,
        "successes": sum(t["success"] for t in trials),
        "trials": len(trials),
        "touched": sum(t["reason"].startswith("touched") for t in trials),
        "min_clearance_mm": 1000 * min(t["min_clearance_m"] for t in trials),
        "worst_error_mm": 1000 * max(t["final_error_m"] for t in trials),
        "mean_time_s": sum(t["time_s"] for t in trials) / len(trials),
        "saturated": max(t["saturated"] for t in trials),
        "path_dtw_cm": path and path["dtw_cm"],
        "times_kinematic": path and path["dtw_cm"] / _kinematic(task, source),
        **_seen([trial["tracking"] for trial in trials if trial["tracking"]]),
        "braked_s": max(t["braked_s"] for t in trials),
    }


def _seen(tracking: list[dict[str, Any]]) -> dict[str, Any]:
    """What the camera saw in the trials: images, how many without the object, and root mean squares over all."""
    if not tracking:
        return {}
    images = sum(each["images"] for each in tracking)

    def rms(of: Callable[[dict[str, Any]], float]) -> float:
        return (sum(each["images"] * of(each) ** 2 for each in tracking) / images) ** 0.5

    return {
        "images": images,
        "images_lost": sum(each["lost"] for each in tracking),
        "pose_rms_mm": 1000 * rms(lambda each: each["position_m"]),
        "pose_rms_deg": rms(lambda each: each["angle_deg"]),
        "worst_trial_mm": 1000 * max(each["position_m"] for each in tracking),
        "joint_rms": rms(lambda each: max(each["joints"].values(), default=0.0)),
    }


@cache
def _kinematic(task: str, source: str) -> float:
    """The mean DTW, cm, of demonstrations that are reproduced kinematically, to the skill's targets."""
    skill = load_skill(skill_file(task, source))
    robot = skill.configuration.load_robot()
    prepared = prepare(skill.configuration, robot, demonstrations(task, source))
    return reproduce(skill, robot, prepared, own_targets=False).mean["dtw_cm"]
