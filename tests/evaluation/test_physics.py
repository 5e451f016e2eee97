"""The engines of physics: the same controller in native MuJoCo and in MJX, started from the same places."""

import json
import os
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

# In a process of its own, to see what is printed.
PROGRAM = """
import json, sys
import jax, jax.numpy as jnp, numpy as np
from jaxrmp.evaluation import classify_ends
from jaxrmp.kinematics import ControlPoints, panda
from jaxrmp.leaves import Damping, Posture
from jaxrmp.scenes import arm_alone
from jaxrmp.simulation import MjxEngine, MujocoEngine, Problem, StopCriteria, simulate
from jaxrmp import Translation, compose

robot, goal = panda(), np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.7, 0.8], np.float32)
tree = Posture(jnp.asarray(goal), 1.0, 25.0, 10.0) + Damping(0.1, 5.0)
hand = ControlPoints(robot, ("panda_hand",), np.zeros((1, 3), np.float32))
points = compose(hand, Translation(hand(jnp.asarray(goal))))
problem = Problem(tree, points, hand, robot.lower, robot.upper)
starts = goal + np.array([[0.5, 0.3, -0.4, 0.4, 0.3, -0.3, 0.5], [-0.6, 0.4, 0.5, -0.5, 0.9, 0.4, 0.6]], np.float32)
out = {}
for engine in (MjxEngine, MujocoEngine):
    paths = []
    made = engine(arm_alone(), problem, StopCriteria(duration=3.0), chunk=50)
    found = simulate(made, starts, batch=2, watch=lambda places, state: paths.append(state.q.tolist()))
    track = found.track
    out[made.name] = {
        "path": paths, "status": found.status.tolist(), "rise": (track.rise / (track.energy - track.least)).tolist(),
        "touched": track.touched.tolist(), "kind": classify_ends(problem, None, found).kind.tolist(),
    }
json.dump(out, open(sys.argv[1], "w"))
"""


@pytest.fixture(scope="module")
def rollouts(tmp_path_factory):
    pytest.importorskip("mujoco.mjx", reason="needs mujoco-mjx")
    out = tmp_path_factory.mktemp("physics") / "out.json"
    cache = jax.config.values["jax_compilation_cache_dir"] or ""
    environment = {**os.environ, "JAX_PLATFORMS": "cpu", "JAX_COMPILATION_CACHE_DIR": cache}
    environment["PYTHONPATH"] = str(Path(__file__).parents[2])
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(out)], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "warp" not in done.stdout + done.stderr
    return json.loads(out.read_text())


def test_mjx_and_native_mujoco_go_the_same_way(rollouts):
    a, b = (np.array(rollouts[name]["path"]) for name in ("mjx", "mujoco"))
    steps = min(len(a), len(b), 40)  # the first 2 s
    assert steps > 10
    np.testing.assert_allclose(a[:steps], b[:steps], atol=1e-3)
    assert np.abs(a[steps - 1] - a[0]).max() > 0.3  # it is a motion that they agree on


@pytest.mark.parametrize("engine", ["mjx", "mujoco"])
def test_physics_brings_the_arm_to_its_goal_and_energy_falls(rollouts, engine):
    found = rollouts[engine]
    assert found["kind"] == [1, 1]
    assert max(found["rise"]) < 1e-3
    assert found["touched"] == [0, 0]
