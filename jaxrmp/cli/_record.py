"""`jaxrmp record`: demonstrations on an arm that is guided by hand."""

import argparse
import os
import select
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from .. import hardware
from .._errors import ConfigurationError, DemonstrationError
from ..kinematics import Robot, load_robot, panda
from ._arms import arm_of, check_model, check_writable, running_until_interrupted, sightings_of, write_log
from ._output import tell

_LEAST = 0.02  # rad, below which nothing moved


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    if bool(arguments.object) != bool(arguments.tracker):
        raise ConfigurationError("--object NAME and --tracker udp:PORT belong together: give both, or neither.")
    if arguments.seconds is None and not sys.stdin.isatty() and not arguments.stdin:
        raise ConfigurationError(
            "there is no terminal to press Enter in: --seconds S records one demonstration of so many seconds; --stdin "
            "takes lines from a pipe."
        )
    robot = panda() if arguments.model == "panda" else load_robot(arguments.model)
    check_writable(arguments.out)
    hardware.check_log_folder(arguments.out, robot.name, robot.joint_names, arguments.object or "")
    with running_until_interrupted() as running, arm_of(arguments, None, None) as arm:
        if why := check_model(arm, robot, arm.read()):
            tell(f"whether the arm's kinematics are those of --model could not be checked wholly: {why}.")
        with sightings_of(arguments.tracker, 0, running) as sightings:
            _record_all(arguments, arm, robot, sightings, running)


def _record_all(
    arguments: argparse.Namespace, arm: Any, robot: Robot, sightings: Any, running: Callable[[], bool]
) -> None:
    if arguments.seconds is not None:
        until = time.perf_counter() + arguments.seconds
        if not _keep(arguments, arm, robot, sightings, lambda: running() and time.perf_counter() < until):
            raise DemonstrationError("nothing was kept: guide the arm by hand while it records.")
        return
    said = "Enter begins a demonstration, Enter again ends it; q and Enter, or Ctrl-C, ends the command."
    print(said, flush=True)
    lines = _Lines()
    while (line := lines.next(arm, running)) is not None and line != "q":
        print("recording ...", flush=True)
        _keep(arguments, arm, robot, sightings, lambda: running() and not lines.ready())
        if not running() or lines.next(arm, running) == "q":
            return


def _keep(arguments: argparse.Namespace, arm: Any, robot: Robot, sightings: Any, going: Callable[[], bool]) -> bool:
    """Record one, and write it unless nothing moved, which is told; whether it was kept."""
    found = hardware.record(arm, going, arguments.rate, sightings)
    count = len(found["time"])
    moved = float(np.ptp(found["joint_positions"], axis=0).max()) if count else 0.0
    if count < 2 or moved < _LEAST:
        tell(f"no joint moved by {_LEAST} rad in that, so it is not kept. Guide the arm by hand while it records.")
        return False
    file, bag, why = write_log(found, arguments.out, robot, arguments.object or "")
    if why:
        tell(why)
    rate = (count - 1) / max(found["time"][-1], 1e-9)
    print(f"{file}: {found['time'][-1]:.1f} s, {count} samples at {rate:.0f} Hz{f'; {bag}' if bag else ''}", flush=True)
    return True


class _Lines:
    """Lines of standard input, for which nothing waits."""

    def __init__(self) -> None:
        self._came: list[str | None] = []  # several at once, perhaps; None for the end

    def ready(self) -> bool:
        """Whether a line waits, or the end."""
        return bool(self._came) or bool(select.select([sys.stdin], [], [], 0.0)[0])

    def next(self, arm: Any, running: Callable[[], bool]) -> str | None:
        """The next line; None at the end or when interrupted. The arm is read meanwhile, as its network asks."""
        while running():
            if self.ready():
                if not self._came:  # unbuffered, since what is read ahead cannot be waited for
                    content = os.read(sys.stdin.fileno(), 65_536).decode(errors="replace")
                    self._came.extend(content.splitlines() or [None])
                line = self._came.pop(0)
                return line if line is None else line.strip()
            arm.read()
        return None
