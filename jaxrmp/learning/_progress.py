"""How far learning is, for a person who waits for it."""

import contextlib
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Literal

Progress = Callable[[str, float], None]
Shown = Literal["shown"]

_LAYOUT = "{desc:<14} {percentage:3.0f} %|{bar}| {elapsed}"


@contextlib.contextmanager
def bar() -> Iterator[Progress]:
    """A function `(step, fraction)` that draws a bar on stderr, by tqdm, whose seconds go on meanwhile."""
    from tqdm import tqdm

    with tqdm(total=1.0, bar_format=_LAYOUT, file=sys.stderr, leave=False) as drawn:
        done = threading.Event()

        def show(step: str, fraction: float) -> None:
            drawn.set_description_str(step, refresh=False)
            drawn.n = fraction
            drawn.refresh()

        def tick() -> None:  # where a step says nothing for long
            while not done.wait(0.5):
                drawn.refresh()

        ticking = threading.Thread(target=tick, daemon=True)
        ticking.start()
        try:
            yield show
        finally:
            done.set()
            ticking.join()


@contextlib.contextmanager
def shown(progress: Progress | Shown | None) -> Iterator[Progress]:
    """What to call for `progress`: itself; for "shown" a bar, in a terminal or a notebook with tqdm, else nothing."""
    if callable(progress):
        yield progress
    elif progress is None or not (sys.stderr.isatty() or "ipykernel" in sys.modules) or not _has_tqdm():
        yield lambda step, fraction: None
    else:
        with bar() as drawn:
            yield drawn


def _has_tqdm() -> bool:
    with contextlib.suppress(ImportError):
        import tqdm

        return bool(tqdm)
    return False
