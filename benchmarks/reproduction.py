"""How well demonstrations are reproduced, over seeds, beside the yardsticks known for the same recordings."""

from dataclasses import replace
from typing import Any

from jaxrmp.cli._sources import find_demonstrations, robot_of
from jaxrmp.learning import learn, load_configuration, reproduce

SEEDS = (0, 1, 2)
# The authors' logged reproductions and the distance from one demonstration to another, on the real recordings, m to cm.
YARDSTICKS = {
    "drawer_closing": {"authors": (3.8, 7.3, 2.9), "human to human": (12.3, 34.8, None)},
    "door_reaching": {"authors": (5.4, 8.1, 6.5), "human to human": (10.1, 21.9, None)},
}


def rows() -> list[dict[str, Any]]:
    """One row a task and seed with the committed configuration, then that task's yardsticks (2026-11)."""
    found: list[dict[str, Any]] = []
    for task, yardsticks in YARDSTICKS.items():
        configuration = load_configuration(f"configs/{task}.toml")
        robot, demonstrations = robot_of(configuration), find_demonstrations(None, task)
        for seed in SEEDS:
            learning = learn(replace(configuration, seed=seed), robot, demonstrations)
            result = reproduce(learning.skill, robot, learning.prepared)
            worst = max(e["goal_cm"] for e in result.errors)
            margin = min(e["limit_margin_rad"] for e in result.errors)
            mean = {name: result.mean[name] for name in ("dtw_cm", "frechet_cm", "goal_cm")}
            found.append(
                {"name": task, "source": f"seed {seed}", **mean, "worst_goal_cm": worst, "limit_margin_rad": margin}
            )
        for source, (dtw, frechet, goal) in yardsticks.items():
            found.append({"name": task, "source": source, "dtw_cm": dtw, "frechet_cm": frechet, "goal_cm": goal})
    return found
