"""Commands that show a page: start it, say where it is, and end it."""

import signal
import threading

from ..viewer import Session


def show(session: Session, until_closed: bool, hint: str) -> None:
    """Run a page until Ctrl-C, or until it is closed if that is asked for. Both are the way out, and no error.

    **Raises** what ends the page otherwise.
    """
    print("compiling the policy (seconds, the first time up to a minute) ...", flush=True)
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in what a script starts in the background
    try:
        session.start()
        print(f"The page is at {session.url}, for this machine only. {hint} Ctrl-C ends it.", flush=True)
        session.wait(until_closed)
    except KeyboardInterrupt:
        print()
    finally:
        session.stop()
