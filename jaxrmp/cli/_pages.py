"""Commands that show a page: make it, start it, say where it is, and end it."""

import argparse
import contextlib
import signal
import threading
import time
from collections.abc import Callable

from ..viewer import Session
from ._optional import require
from ._output import progress_bar


def show(make: Callable[[Callable[[str, float], None]], Session], arguments: argparse.Namespace, hint: str) -> None:
    """Run the page that `make` makes, given a function that tells of its steps, until Ctrl-C, or until it is closed if
    that is asked for. Both are the way out, and no error. `hint` is what to do there; `{hand}` is the frame that moves.

    **Raises** what ends the page otherwise.
    """
    require("viewer")
    begun = time.monotonic()
    with contextlib.ExitStack() as coming:
        progress = coming.enter_context(progress_bar(arguments.quiet))
        session: Session | None = None
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, signal.default_int_handler)
            signal.signal(signal.SIGINT, signal.default_int_handler)  # which a script's background jobs ignore
        try:
            session = make(progress)
            progress("compiling", 0.5)
            session.start()
            coming.close()
            hint = hint.format(hand=session.content.hand)
            print(
                f"The page is at {session.url}, for this machine only, after {time.monotonic() - begun:.0f} s. {hint} "
                "Ctrl-C ends it.",
                flush=True,
            )
            session.wait(arguments.until_closed)
        except KeyboardInterrupt:
            print()
        finally:
            if session is not None:
                session.stop()
