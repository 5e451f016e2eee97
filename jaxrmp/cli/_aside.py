"""Work beside the main thread, which an interrupt ends at once."""

import os
import sys
import threading
from collections.abc import Callable
from typing import Any


def aside(work: Callable[[], Any]) -> Any:
    """What `work()` gives, done in a thread; what it raises is raised here.

    An interrupt ends the process with exit code 130, without waiting for a program that is being compiled, as the main
    thread would have to. So `work` writes no files: do that with what it gives.
    """
    given: list[Any] = []
    failed: list[BaseException] = []

    def run() -> None:
        try:
            given.append(work())
        except BaseException as error:  # raised again below
            failed.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        while thread.is_alive():
            thread.join(0.1)
    except KeyboardInterrupt:
        print("\njaxrmp: interrupted; no file was left half-written", file=sys.stderr, flush=True)
        os._exit(130)
    if failed:
        raise failed[0]
    return given[0]
