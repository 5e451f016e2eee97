"""Commands that run as several processes: started here on this machine, or by the user on many."""

import socket
import subprocess
import sys

from .._errors import RolloutError


def spawn(processes: int, command_line: list[str]) -> None:
    """Run this same command as so many processes on this machine, and wait for them.

    **Raises** `RolloutError` if one fails; the others are ended then.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        coordinator = f"127.0.0.1:{probe.getsockname()[1]}"
    command = [sys.executable, "-m", "jaxrmp", *command_line, "--coordinator", coordinator, "--process"]
    children = [subprocess.Popen([*command, str(i)]) for i in range(processes)]
    try:
        codes = _wait(children)
    finally:
        for child in children:
            if child.poll() is None:
                child.terminate()
    if any(codes):
        raise RolloutError(f"of {processes} processes, {sum(code != 0 for code in codes)} failed; see above.")


def _wait(children: list[subprocess.Popen]) -> list[int]:
    """Exit codes of all; as soon as one fails, the others are ended, for they would wait for it."""
    left = list(children)
    while left:
        for child in list(left):
            try:
                code = child.wait(timeout=0.2)
            except subprocess.TimeoutExpired:
                continue
            left.remove(child)
            if code:
                for other in left:
                    other.terminate()
    return [child.returncode for child in children]
