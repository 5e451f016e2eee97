"""SIGINT, SIGTERM and SIGHUP end a command within two seconds, whatever it is doing, and leave nothing half-written."""

import contextlib
import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator, Mapping
from typing import Any, NoReturn

from .._unfinished import forget_unfinished

PATIENCE = 1.5
"""Seconds that a command has to end by itself, after a signal."""
CODES = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}
"""Signals that end a command, and exit codes, as shells have them."""
INTERRUPTED = "jaxrmp: interrupted; no file was left half-written"


class Ended(KeyboardInterrupt):
    """A signal came that ends the command; `code` is what the process ends with."""

    def __init__(self, code: int):
        super().__init__()
        self.code = code


def heard() -> list[signal.Signals]:
    """The signals that end a command: not the end of its terminal where whoever started it had that ignored (nohup)."""
    return [n for n in CODES if n != signal.SIGHUP or signal.getsignal(n) is not signal.SIG_IGN]


@contextlib.contextmanager
def ended_by_signals(codes: Mapping[signal.Signals, int] = CODES) -> Iterator[None]:
    """Within it what is `heard` raises `Ended`, and ends the process, with its code of `codes`, where Python does not.

    Python hears a signal between two of its own steps only, and a compilation is one step that may take a minute: after
    `PATIENCE` a thread ends the process then, once unfinished files are gone. Outside of the main thread, where signals
    are not heard, nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    hears, tells = socket.socketpair()
    tells.setblocking(False)
    over = threading.Event()

    def stop(number: int, frame: object) -> None:
        raise Ended(codes[signal.Signals(number)])

    def listen() -> None:
        while (said := hears.recv(1)) and not over.is_set():
            if said[0] not in before:
                continue
            if not over.wait(PATIENCE):
                forget_unfinished()
                os.write(2, f"\n{INTERRUPTED}\n".encode())
                os._exit(codes[signal.Signals(said[0])])

    def lost(unraisable: Any) -> None:  # raised where nothing can be: the listener ends it then
        if not isinstance(unraisable.exc_value, Ended):
            hook(unraisable)

    before, hook = {number: signal.signal(number, stop) for number in heard()}, sys.unraisablehook
    sys.unraisablehook = lost
    descriptor = signal.set_wakeup_fd(tells.fileno(), warn_on_full_buffer=False)
    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    try:
        yield
    finally:
        over.set()
        signal.set_wakeup_fd(descriptor)
        sys.unraisablehook = hook
        for number, handler in before.items():
            signal.signal(number, handler)
        tells.close()
        listener.join()
        hears.close()


@contextlib.contextmanager
def killed_by_signals() -> Iterator[None]:
    """Within it what is `heard` ends the process on the spot: for a call of somebody's library that lets no thread of
    Python run, where nothing is under way that could be left half done."""
    before = {number: signal.signal(number, signal.SIG_DFL) for number in heard()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def end_at_once(code: int, word: str) -> NoReturn:
    """End the process with `code` and a `word` on stderr, without the interpreter's own end: threads that compile do
    not live through that, and cannot be waited for."""
    forget_unfinished()
    with contextlib.suppress(OSError, ValueError):  # nobody reads any more
        print(word, file=sys.stderr, flush=True)
        sys.stdout.flush()
    os._exit(code)


def end_with_parent(parent: int, every: float = 0.5) -> None:
    """Let this process end soon after its `parent` has, however that ended."""

    def watch() -> None:
        while os.getppid() == parent:
            threading.Event().wait(every)
        forget_unfinished()
        print("jaxrmp: the process that started this one is gone", file=sys.stderr, flush=True)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
