"""`jaxrmp export`: a skill as a file that other programs run: C that a controller compiles, StableHLO."""

import argparse
import contextlib
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .. import export
from .._errors import ConfigurationError, DemonstrationError, ExportError
from .._forms import resolve
from ..kinematics import Robot
from ..learning import Skill, prepare
from ..policies import goal_distance, whole_arm_policy
from ..world import Spheres, World
from ._export_stablehlo import write_skill_stablehlo
from ._optional import require
from ._output import progress_bar, tell
from ._sources import demonstrations_of, skill_and_robot

_UNITS = {
    "q": "rad, or m",
    "qd": "rad/s, or m/s",
    "qdd": "rad/s^2, or m/s^2",
    "T_world_object": "where the object is, in the world of the robot's model, m",
    "obstacles_center": "m, in the world",
    "obstacles_radius": "m",
    "obstacles_active": "0 for a slot without an obstacle",
    "goal_distance": "m, of the first control point from its goal",
    "V": "energy, which never rises where nothing in the world moves",
    "dissipation": "at which it falls, per second",
}


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    if not (arguments.c or arguments.stablehlo):
        raise ConfigurationError("say what to write: --c DIR, --stablehlo FILE, or both.")
    if arguments.obstacles < 0:
        raise ConfigurationError(f"--obstacles is {arguments.obstacles}, expected 0 or more.")
    if arguments.stablehlo:
        require("export")
    skill, robot = skill_and_robot(arguments.skill, arguments.robot)
    if arguments.stablehlo:
        file = write_skill_stablehlo(skill, robot, arguments.stablehlo)
        print(f"wrote {file}: call(q, qd, T_world_object) gives qdd; the object was learned with at")
        print(np.array2string(np.asarray(skill.T_world_object), separator=", ", precision=6, suppress_small=True))
    if arguments.c:
        _write_c(arguments, skill, robot)


def _write_c(arguments: argparse.Namespace, skill: Skill, robot: Robot) -> None:
    with progress_bar(arguments.quiet) as progress:
        progress("writing", 0.0)
        asked = arguments.obstacles, arguments.certificate, arguments.precision, arguments.while_count
        try:
            found = skill_in_c(skill, robot, *asked)
        except ExportError as error:
            given = [f"fewer --obstacles than {arguments.obstacles}"] * bool(arguments.obstacles)
            given += ["no --certificate"] * arguments.certificate
            raise ExportError(f"{error} Say {' or '.join(given)}." if given else str(error)) from error
        progress("starting", 0.8)
        q, T, start = _start(skill, robot, arguments.demos)
        files = export.write_project(found, {"q": q, "T_world_object": T}, start, arguments.c)
    print(f"wrote {', '.join(file.name for file in files)} to {arguments.c}")
    kilobytes = len(found.source.encode()) / 1000
    print(f"{found.operations:,} operations, {kilobytes:.0f} kB of source, {found.stack:,} bytes of stack")
    print(f"fingerprint {found.fingerprint}")


def skill_in_c(
    skill: Skill,
    robot: Robot,
    obstacles: int = 0,
    certificate: bool = False,
    precision: str = "float",
    max_iterations: int | None = None,
) -> export.CSource:
    """The `whole_arm_policy` of a skill as C: `q`, `qd`, where the object is and `obstacles` slots for spheres to
    `qdd` and `goal_distance`, unless it is of a turn alone, and with a `certificate` to the tree's energy `V` and its
    `dissipation`, too.
    `max_iterations` as of `export.c`.

    **Raises** `ExportError`, else as `whole_arm_policy`.
    """
    real = np.dtype(np.float32 if precision == "float" else np.float64)

    def of_precision(tree: Any, array: Any) -> Any:
        return jax.tree.map(lambda a: array(a, bool if np.asarray(a).dtype == bool else real), tree)

    with jax.enable_x64(True) if precision == "double" else contextlib.nullcontext():
        # In the precision asked for throughout: what it computes of its own numbers, too.
        policy = of_precision(whole_arm_policy(skill, robot), jnp.asarray)

        def whole(q: Any, qd: Any, T_world_object: Any, obstacles: Any) -> dict[str, Any]:
            tree = policy.tree(T_world_object, World(spheres=obstacles))
            found = {} if skill.of_turn else {"goal_distance": goal_distance(policy, q, T_world_object)}
            if not certificate:
                return {"qdd": resolve(tree(q, qd)), **found}
            measured = tree.measure(q, qd)
            found |= {"V": measured.energy, "dissipation": measured.dissipation}
            return {"qdd": resolve(measured.form.dense()), **found}

        q, T = np.zeros(robot.num_joints, real), np.eye(4, dtype=real)
        slots = of_precision(Spheres.of([], capacity=obstacles) if obstacles else None, np.asarray)
        name, about = skill.configuration.name, f"The skill {skill.configuration.name} on {robot.name}"
        about += f", kinematics {robot.fingerprint}."
        units = dict(_UNITS)
        if not skill.configuration.object:
            units["T_world_object"] = "m; nothing is tracked: always as in main.c, where the demonstrations end"
        return export.c(whole, q, q, T, slots, name=name, units=units, about=about, max_iterations=max_iterations)


def _start(skill: Skill, robot: Robot, named: str | None) -> tuple[np.ndarray, np.ndarray, str]:
    """Joint positions and object's pose to start from, and what they are."""
    try:
        prepared = prepare(skill.configuration, robot, demonstrations_of(skill, named, robot))
        return np.asarray(prepared.joints.q[0][0]), np.asarray(prepared.poses[0]), "the first demonstration's start"
    except DemonstrationError as error:
        if named:
            raise
        tell(f"main.c starts in the middle of the joints' ranges. {error}")
    bounds = np.clip([robot.lower, robot.upper], -np.pi, np.pi)
    return bounds.mean(axis=0), np.asarray(skill.T_world_object), "the middle of the joints' ranges"
