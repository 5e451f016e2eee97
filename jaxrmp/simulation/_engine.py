"""One interface for rollouts from many starts, whatever moves the joints; and the conveyor that feeds it."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, Protocol

import jax
import numpy as np

from .._errors import ConfigurationError, ShapeError
from ._devices import Devices
from ._judge import End, StopCriteria, Track

_LEAST = 16  # starts: below it, a smaller batch is hardly faster, and is one more program to compile


class Engine(Protocol):
    """What moves joints: states of B starts in, states `chunk` steps of `dt` seconds later out.

    A state is a named tuple of arrays with a leading axis of B, on the host, with `q`, `qd` [B, n] and `track`.
    """

    name: str
    criteria: StopCriteria
    dt: float
    chunk: int
    devices: Devices

    def begin(self, q: np.ndarray) -> Any:
        """States at rest at `q` [B, n]."""
        ...

    def advance(self, state: Any) -> Any:
        """`chunk` steps of all in `state` that have not ended."""
        ...

    def bytes_needed(self, batch: int) -> int:
        """Memory that one call with `batch` starts takes on each device."""
        ...


class Outcomes(NamedTuple):
    """How N rollouts ended: `q`, `qd` [N, n], the last states (the last finite ones), and `track`, all [N]."""

    q: np.ndarray
    qd: np.ndarray
    track: Track

    @property
    def status(self) -> np.ndarray:
        """`End` of each, [N]."""
        return np.asarray(self.track.status)

    def take(self, indices: np.ndarray) -> "Outcomes":
        """Those of the starts `indices` [K]."""
        return jax.tree.map(lambda array: array[indices], self)


def largest_batch(engine: Engine, wanted: int) -> int:
    """The largest batch, `wanted` or halves of it, whose call of `engine` fits into half of the memory that is free.

    **Raises** `ConfigurationError` if not even one start a device fits.
    """
    free, count = engine.devices.free_memory(), engine.devices.count
    batch = max(wanted // count, 1) * count
    while free is not None and (needed := engine.bytes_needed(batch)) > free / 2:
        if batch == count:
            raise ConfigurationError(
                f"one start a device takes {needed / 1e6:.0f} MB, and {free / 1e6:.0f} MB of memory are free, of which "
                "half is used at most. Free memory, or use fewer devices."
            )
        batch = max(batch // 2 // count, 1) * count
    return batch


def simulate(
    engine: Engine,
    starts: np.ndarray,
    *,
    batch: int = 1024,
    progress: Callable[[int, int], None] | None = None,
    watch: Callable[[np.ndarray, Any], None] | None = None,
    ended: Callable[[np.ndarray, Outcomes], None] | None = None,
) -> Outcomes:
    """Roll out by `engine` from many starts, `batch` of them at a time: whoever ends makes room for the next one.

    So the work is the sum of the rollouts' own lengths, and memory does not grow with the number of starts. Only few
    sizes of batch are ever compiled: `batch`, and a quarter and a sixteenth of it for the last ones.

    **Arguments**: `starts` [N, n], at rest; `progress`, called with how many have ended and N; `watch`, called after
    every chunk with the indices of the starts in the batch [B] (-1 where a place is empty) and their states; `ended`,
    called with the indices of those that have ended since and how.
    **Returns** `Outcomes`. **Raises** `ShapeError`, `ConfigurationError` for a batch that devices cannot share.
    """
    starts = np.asarray(starts, np.float32)
    if starts.ndim != 2 or not len(starts):
        raise ShapeError(f"starts has shape {starts.shape}, expected [N, n] with at least one start.")
    count = engine.devices.count
    if batch < count or batch % count:
        raise ConfigurationError(f"batch is {batch}, expected a multiple of the {count} devices.")
    waiting = iter(range(len(starts)))
    batch = next(size for size in _sizes(batch, count) if size >= min(len(starts), batch))
    places = _next(waiting, batch)
    state = engine.begin(starts[places])  # places of -1 hold the last start, and are ignored
    found: Outcomes | None = None
    count_ended = 0
    while (places >= 0).any():
        state = engine.advance(state)
        if watch:
            watch(places, state)
        done = (places >= 0) & (state.track.status != End.RUNNING)
        if not done.any():
            continue
        last = Outcomes(state.q[done], state.qd[done], jax.tree.map(lambda a, done=done: a[done], state.track))
        if found is None:
            found = jax.tree.map(lambda a: np.empty((len(starts), *a.shape[1:]), a.dtype), last)
        for array, values in zip(jax.tree.leaves(found), jax.tree.leaves(last), strict=True):
            array[places[done]] = values
        count_ended += int(done.sum())
        if ended:
            ended(places[done], last)
        if progress:
            progress(count_ended, len(starts))
        state, places = _refilled(engine, state, places, done, waiting, starts)
        state, places = _packed(state, places, _sizes(batch, count))
    assert found is not None
    return found


def _sizes(batch: int, count: int) -> list[int]:
    """The sizes that batches may have, rising: a sixteenth and a quarter of `batch`, if at least 16, and itself."""
    parts = {max(batch // part // count, 1) * count for part in (16, 4)}
    return sorted({batch, *(size for size in parts if size >= _LEAST)})


def _next(waiting: Iterator[int], room: int) -> np.ndarray:
    """The next indices, -1 where there are no more."""
    return np.array([next(waiting, -1) for _ in range(room)])


def _refilled(engine: Engine, state: Any, places: np.ndarray, done: np.ndarray, waiting: Iterator[int], starts):
    """New starts in the places of those that are done, or none."""
    places = places.copy()
    places[done] = new = _next(waiting, int(done.sum()))
    if (new < 0).all():
        return state, places
    fresh = engine.begin(starts[places])
    filled = done & (places >= 0)
    return jax.tree.map(
        lambda old, new: np.where(filled.reshape(-1, *(1,) * (old.ndim - 1)), new, old), state, fresh
    ), places


def _packed(state: Any, places: np.ndarray, sizes: list[int]):
    """The same starts in the smallest batch that holds them."""
    held = np.flatnonzero(places >= 0)
    size = next(size for size in sizes if size >= len(held))
    if size >= len(places) or not len(held):
        return state, places
    rows = np.concatenate([held, np.repeat(held[:1], size - len(held))])
    kept = places[rows]
    kept[len(held) :] = -1
    return jax.tree.map(lambda a: a[rows], state), kept
