"""Commands that show a page: make it, start it, say where it is, and end it."""

import argparse
import contextlib
import time
from collections.abc import Callable

from ..viewer import Access, Session
from ._optional import require
from ._output import progress_bar, tell


def show(make: Callable[[Callable[[str, float], None]], Session], arguments: argparse.Namespace, hint: str) -> None:
    """Run the page that `make` makes, given a function that tells of its steps, until it is closed, if that is asked
    for, or else until Ctrl-C. `hint` is what to do there; `{hand}` is the frame that moves.

    **Raises** what ends the page otherwise, and what a signal raises at once: a thread that compiles can be waited for
    when a page ends by itself, but not then.
    """
    require("viewer")
    begun = time.monotonic()
    with contextlib.ExitStack() as coming:
        progress = coming.enter_context(progress_bar(arguments.quiet))
        session = make(progress)
        try:
            if not arguments.quiet:
                tell(f"{session.url} is there already; its arm moves once the policy is compiled.")
            progress("compiling", 0.5)
            session.start()
            coming.close()
            hint = hint.format(hand=session.content.hand)
            print(
                f"The page is at {session.url}, {_for_whom(session.access)}, after {time.monotonic() - begun:.0f} s. "
                f"{hint} "
                "Ctrl-C ends it.",
                flush=True,
            )
            session.wait(arguments.until_closed)
        except Exception:
            session.stop()
            raise
        session.stop()


def access_of(arguments: argparse.Namespace) -> Access:
    """Who may see the page, by `--host` and `--password`. **Raises** `ConfigurationError` as `Access.check`."""
    access = Access(arguments.host, arguments.password)
    access.check()
    return access


def _for_whom(access: Access) -> str:
    if access.local:
        return "for this machine only" + (", with the password" if access.password else "")
    return "for whoever has the password (any user's name; not encrypted: use it in a network that you trust)"
