"""Commands that run as several processes: started here on this machine, or by the user on many."""

import os
import socket
import subprocess
import sys
import threading
import time
from typing import IO

from .._errors import RolloutError

PARENT = "JAXRMP_PARENT"
"""The variable that tells a process started here which one did, so that it does not live on alone."""
_PATIENCE = 0.5  # s, from the word to end to the end


def spawn(processes: int, command_line: list[str]) -> None:
    """Run this same command as so many processes on this machine, and wait for them; what they say is labelled.

    None of them outlives this one. **Raises** `RolloutError` if one fails; the others are ended then.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        coordinator = f"127.0.0.1:{probe.getsockname()[1]}"
    command = [sys.executable, "-m", "jaxrmp", *command_line, "--coordinator", coordinator, "--process"]
    environment = {**os.environ, PARENT: str(os.getpid()), "PYTHONUNBUFFERED": "1"}
    children, labels = list[subprocess.Popen[str]](), list[threading.Thread]()
    failed = list[str]()
    try:
        for i in range(processes):
            child = subprocess.Popen([*command, str(i)], env=environment, stderr=subprocess.PIPE, text=True)
            children.append(child)
            assert child.stderr is not None
            labels.append(threading.Thread(target=_label, args=(f"process {i}", child.stderr), daemon=True))
            labels[-1].start()
        running = True
        while running and not failed:
            time.sleep(0.1)
            codes = [child.poll() for child in children]
            running = None in codes
            failed = [str(i) for i, code in enumerate(codes) if code]  # the others would wait for it
    finally:
        _end(children)
    for label in labels:
        label.join(_PATIENCE)  # what they said last is said before how it ended
    if failed:
        raise RolloutError(
            f"process {' and '.join(failed)} of {processes} failed, and the others were ended; see above."
        )


def _label(name: str, lines: IO[str]) -> None:
    for line in lines:
        print(f"{name}: {line.rstrip()}", file=sys.stderr, flush=True)


def _end(children: list[subprocess.Popen[str]]) -> None:
    """End those that have not: by a word, and where that is not heard, by force."""
    running = [child for child in children if child.poll() is None]
    for child in running:
        child.terminate()
    until = time.monotonic() + _PATIENCE
    for child in running:
        try:
            child.wait(max(until - time.monotonic(), 0))
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
