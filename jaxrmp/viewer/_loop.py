"""The thread that runs the policy at the pace of the clock."""

import threading
import time
from collections.abc import Callable
from dataclasses import fields
from typing import NamedTuple

import jax
import numpy as np

from ..simulation import Motion
from ._live import STEP, Situation, advance
from ._real_time import Rates, RealTime
from ._watch import EnergyWatch, Watched

FRAME = 1 / 60
"""Seconds from one call of the policy's program to the next."""


class Frame(NamedTuple):
    """The arm as it is: `number` of the frame; simulated `time`, s; `q`, `qd` [n]; `poses` [F, 4, 4]; the `situation`
    that it came from; the `rates` of the loop and what the certificate says."""

    number: int
    time: float
    q: np.ndarray
    qd: np.ndarray
    poses: np.ndarray
    situation: Situation
    rates: Rates
    watched: Watched


class LiveLoop:
    """Runs the policy in a thread of its own: 1,000 steps a second of simulated time, as many calls as page updates.

    `ready` is set once there is a frame; `failure`, what ended it, if something did that should not have.

    **Arguments**: `read`, which gives the `Situation` as it is now and is called once a frame; `q` [n], where the arm
    starts, at rest; `frames`, whose poses are wanted; `hand`, the frame that is pushed; `on_frame`, called with every
    `Frame` in the loop's thread, so it must be quick; `on_stop`, called with a message when the policy cannot go on.
    """

    def __init__(
        self,
        read: Callable[[], Situation],
        q: np.ndarray,
        frames: tuple[str, ...],
        hand: str,
        on_frame: Callable[[Frame], None] = lambda frame: None,
        on_stop: Callable[[str], None] = lambda message: None,
    ):
        self.playing, self.speed = True, 1.0
        self._read, self._frames, self._hand = read, frames, hand
        self._on_frame, self._on_stop = on_frame, on_stop
        self._motion = Motion.at_rest(q)
        self._reset_to: np.ndarray | None = None
        self._follow: Callable[[float], np.ndarray | None] | None = None
        self._time, self._steps, self._watch = 0.0, 0, EnergyWatch()
        self._news = threading.Condition()
        self._frame: Frame | None = None
        self._end, self.ready = threading.Event(), threading.Event()
        self.failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="policy", daemon=True)

    def prepare(self) -> None:
        """Compile, and take the first frame."""
        self._step(0, Rates(0.0, 0.0, 1.0, 0.0))
        self.ready.set()

    def start(self) -> None:
        """Run from now on; after `prepare`."""
        self._clock = RealTime(STEP, time.perf_counter())
        self._thread.start()

    def stop(self) -> None:
        """End the thread and wait for it."""
        self._end.set()
        self.ready.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(timeout=10.0)
        with self._news:
            self._news.notify_all()

    def reset(self, q: np.ndarray) -> None:
        """Put the arm at rest at `q` [n], before the next frame."""
        self._reset_to = np.array(q, np.float32)

    def replay(self, follow: Callable[[float], np.ndarray | None] | None) -> None:
        """Have the arm follow a path instead of the policy: `follow(seconds)` gives `q` [n] after so many simulated
        seconds, None once it is over. None ends it at once."""
        self._followed = 0.0
        self._follow = follow

    def passed(self) -> float:
        """Simulated seconds of the last call; infinite while none pass: in a pause, on a path, before the start."""
        running = self.playing and not self.replaying and self._frame is not None
        return self._steps * STEP if running else np.inf

    @property
    def q(self) -> np.ndarray:
        """Where the arm is, [n], before the first frame too."""
        return np.asarray(self._motion.q)

    @property
    def replaying(self) -> bool:
        """Whether the arm follows a path."""
        return self._follow is not None

    @property
    def frame(self) -> Frame:
        """The newest frame. Only after `prepare`."""
        assert self._frame is not None
        return self._frame

    def next_frame(self, after: int, timeout: float = 0.5) -> Frame:
        """Wait for a frame newer than number `after`; the newest one if none comes in time."""
        with self._news:
            self._news.wait_for(lambda: self._end.is_set() or self.frame.number > after, timeout)
        return self.frame

    def _run(self) -> None:
        deadline = time.perf_counter()
        try:
            while not self._end.is_set():
                now = time.perf_counter()
                steps = self._clock.due(now, self.speed if self.playing else 0.0)
                self._step(steps, self._clock.rates())
                deadline = max(deadline + FRAME, time.perf_counter())
                self._end.wait(deadline - time.perf_counter())
        except BaseException as error:
            self.failure = error
            self._end.set()
            with self._news:
                self._news.notify_all()

    def _step(self, steps: int, rates: Rates) -> None:
        moved = self._reset_to is not None
        if self._reset_to is not None:
            self._motion, self._reset_to = Motion.at_rest(self._reset_to), None
        situation, before = self._read(), self._motion
        if follow := self._follow:
            self._followed += steps * STEP
            q = follow(self._followed)
            if q is None:
                self._follow = None
            else:
                before, steps, moved = Motion.at_rest(q), 0, True
        reading = advance(situation, before, np.int32(steps), self._frames, self._hand)
        reading = jax.tree.map(np.asarray, reading)
        if not (np.isfinite(reading.motion.q).all() and np.isfinite(reading.motion.qd).all()):
            self.playing = False
            self._motion = Motion.at_rest(before.q)
            self._on_stop(
                "The policy's acceleration is not finite, so the arm stands still. Are all leaves that give every "
                "joint a metric switched off? Switch one on and press Play."
            )
            return
        same = self._frame is not None and self._parts(situation) == self._parts(self._frame.situation)
        watched = self._watch.see(reading, moved or not same, stepped=steps > 0)
        self._motion, self._time, self._steps = reading.motion, self._time + steps * STEP, steps
        number = 0 if self._frame is None else self._frame.number + 1
        m = reading.motion
        frame = Frame(number, self._time, m.q, m.qd, reading.poses, situation, rates, watched)
        self._on_frame(frame)
        with self._news:
            self._frame = frame
            self._news.notify_all()

    @staticmethod
    def _parts(situation: Situation) -> tuple[int, ...]:
        """What a situation is made of: the page gives the same objects until one of them changes."""
        return tuple(id(getattr(situation, field.name)) for field in fields(situation))
