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
    left = list(children)
    try:
        while left:
            for child in list(left):
                try:
                    code = child.wait(timeout=0.2)
                except subprocess.TimeoutExpired:
                    continue
                left.remove(child)
                for other in left if code else ():  # they would wait for the one that failed
                    other.terminate()
    finally:
        for child in children:
            if child.poll() is None:
                child.terminate()
    if failed := sum(child.returncode != 0 for child in children):
        raise RolloutError(f"of {processes} processes, {failed} failed; see above.")
