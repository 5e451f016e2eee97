"""How long a skill takes to learn, from files to saved skill, in a fresh process: with nothing compiled, and again."""

import json
import os
import subprocess
import sys
import tempfile
from typing import Any

SCRIPT = """
import json, sys, time
clock = time.perf_counter()
from jaxrmp.cli._sources import default_demonstrations, find_demonstrations, robot_of
from jaxrmp.learning import learn, load_configuration, save_skill
task, out = sys.argv[1:]
configuration = load_configuration(f"configs/{task}.toml")
learning = learn(configuration, robot_of(configuration), find_demonstrations(default_demonstrations(task)))
save_skill(learning.skill, f"{out}/{task}.skill.npz")
print(json.dumps({"total_s": time.perf_counter() - clock, "loop_s": learning.seconds["metric_loop"],
                  "potentials_s": learning.seconds["potentials"], "source": learning.skill.source[:40]}))
"""


def rows() -> list[dict[str, Any]]:
    """One row a task, without and with the compilation cache: seconds from importing jaxrmp to the saved skill."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        environment = {
            **os.environ,
            "JAX_COMPILATION_CACHE_DIR": f"{folder}/cache",
            "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        }
        for task in ("drawer_closing", "door_reaching"):
            for cache in ("cold", "warm"):
                if task == "door_reaching" and cache == "cold":
                    environment["JAX_COMPILATION_CACHE_DIR"] = f"{folder}/cache_of_door"
                command = [sys.executable, "-c", SCRIPT, task, folder]
                run = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
                found.append({"name": task, "compilation_cache": cache, **json.loads(run.stdout.splitlines()[-1])})
    return found
