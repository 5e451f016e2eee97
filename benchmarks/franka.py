"""A Franka driven over its network protocol: the drawer skill and a reach, on both simulators (`make simulators`).

The strict one ends motions as the arm does, for 20 lost cycles in a row and for every limit of motion. Lateness is this
machine's: run it on a quiet one, of two cores or more.
"""

import os
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp import hardware, learning
from jaxrmp.kinematics import ControlPoints, panda
from jaxrmp.policies import reaching_policy, whole_arm_policy
from jaxrmp.simulation import rollout
from jaxrmp.world import World, own_spheres

from ._franka_simulators import NAMES, missing, simulator
from ._skills import demonstrations, skill_file, source_here

_STRICT = ("--enforce-comm-constraints", "--enforce-motion-limits")
_HOME = np.array([0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.785])
_REPEATS = 2
Hand = Callable[[np.ndarray], np.ndarray]


def rows() -> list[dict[str, Any]]:
    """A row a simulator, task and interface: over its repetitions how often it came to rest at the goal, motions that
    the arm ended, cycles that came late, the largest distance of the hand's way from the kinematic one's, mm, and how
    long our part of a cycle takes, us."""
    found, cores = [], sorted(os.sched_getaffinity(0))
    for name in NAMES:
        os.sched_setaffinity(0, cores)
        if why := missing(name):
            found.append({"name": f"{name}: {why}", **dict.fromkeys(("runs", "arrived", "reflexes", "late_cycles"))})
            continue
        options = _STRICT if name == "franka-sim" else ()
        with tempfile.TemporaryDirectory() as folder, simulator(name, Path(folder), options) as sim:
            _cores_of_their_own(sim.process.pid, cores)
            arm = hardware.FrankaArm(sim.host, "ignore")
            for task, (policy, T, start, hand) in _tasks().items():
                for interface in arm.interfaces:
                    found.append({"name": f"{task}, {interface}, {name}"})
                    found[-1] |= _row(arm, policy, T, start, hand, interface)
            arm.close()
            for row in found:
                if row["name"].endswith(name):
                    row["violations"] = len(sim.violations) if name == "franka-sim" else None
    os.sched_setaffinity(0, cores)
    return found


def _cores_of_their_own(simulator: int, cores: Sequence[int]) -> None:
    """Us on the first of the `cores` and the simulator on the others: on an arm there is none beside us."""
    for thread in Path(f"/proc/{simulator}/task").iterdir() if len(cores) > 1 else ():
        os.sched_setaffinity(int(thread.name), cores[1:])
    os.sched_setaffinity(0, cores[:1])


def _tasks() -> dict[str, tuple[Any, np.ndarray, np.ndarray, Hand]]:
    robot = panda()
    skill = learning.load_skill(skill_file("drawer_closing"))
    shown = demonstrations("drawer_closing", source_here(False))
    prepared = learning.prepare(skill.configuration, robot, shown)
    offsets = np.asarray(skill.offsets, float)

    def of_skill(q: np.ndarray) -> np.ndarray:
        return learning.control_points(robot, skill.frames, offsets, q)[:, 0]

    point = ControlPoints(robot, ("panda_hand_tcp",))
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, 3] = np.asarray(point(jnp.asarray(_HOME)))[0] + [-0.05, 0.25, -0.1]

    def of_reach(q: np.ndarray) -> np.ndarray:
        return np.asarray(jax.vmap(point)(jnp.asarray(q)))[:, 0]

    drawer = whole_arm_policy(skill, robot), np.asarray(skill.T_world_object), np.asarray(prepared.joints.q[0][0])
    return {
        "drawer": (*drawer, of_skill),
        "reach": (reaching_policy(robot, "panda_hand_tcp", _HOME), T, _HOME, of_reach),
    }


def _row(arm: Any, policy: Any, T: np.ndarray, start: np.ndarray, hand: Hand, interface: Any) -> dict[str, Any]:
    robot = panda()
    settings = hardware.DriveSettings(late=0.05)
    law = hardware.law(policy, arm)
    home = hardware.law(hardware.to_posture(robot, start, own_spheres(robot)), arm)
    real_time = False
    ends, busy, late, cycles, off, miss = [], [], 0, 0, [], []
    for _ in range(_REPEATS):
        hardware.drive(arm, home, hardware.Fixed(np.eye(4)), settings)
        drive = hardware.drive(arm, law, hardware.Fixed(T), settings, start=start, interface=interface, priority=50)
        arrays = drive.log.arrays()
        ends.append(drive.end)
        real_time = drive.real_time
        busy.append(arrays["log_busy"][np.isfinite(arrays["log_busy"])])
        late, cycles = late + drive.late, cycles + drive.log.count
        began = jnp.asarray(arrays["log_positions_told"][0])
        alone = rollout(policy.tree(jnp.asarray(T), World()), began, duration=20.0, dt=0.002, warn=False)
        expected, way = hand(np.asarray(alone.q, float)), hand(arrays["joint_positions"][::20])
        off.append(max(np.linalg.norm(expected - p, axis=1).min() for p in way))
        miss.append(np.linalg.norm(way[-1] - expected[-1]))
    took = 1e6 * np.concatenate(busy)
    return {
        "runs": len(ends),
        "real_time": real_time,
        "arrived": sum(end == hardware.DriveEnd.RESTED for end in ends),
        "reflexes": sum(end == hardware.DriveEnd.BY_ARM for end in ends),
        "cycles": cycles,
        "late_cycles": late,
        "off_way_mm": float(1000 * max(off)),
        "off_end_mm": float(1000 * max(miss)),
        "p50_us": float(np.percentile(took, 50)),
        "p99_us": float(np.percentile(took, 99)),
        "p99_9_us": float(np.percentile(took, 99.9)),
    }
