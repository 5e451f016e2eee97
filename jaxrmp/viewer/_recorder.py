"""Demonstrations as they are recorded: begun, ended, played back, thrown away, saved."""

import threading
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .._errors import DemonstrationError
from ..kinematics import Robot
from ..learning import Demonstration, DemonstrationSet, save_demonstrations

TARGET = "target"
"""What the marked frame is called in saved demonstrations, and as the `object` of the configuration to learn them."""
_LEAST = 0.3  # seconds, and
_MOVED = 0.02  # rad or m, below which a recording is no motion


@dataclass(frozen=True)
class Recording:
    """One recorded motion: `time` [T] from zero, s; `q` [T, n]; `hand` [T, 3], where the hand was, m; `T_world_target`
    [4, 4], None if none was marked."""

    time: np.ndarray
    q: np.ndarray
    hand: np.ndarray
    T_world_target: np.ndarray | None = None

    @property
    def duration(self) -> float:
        """Seconds from the first sample to the last."""
        return float(self.time[-1])

    def at(self, seconds: float) -> np.ndarray | None:
        """Where the joints were after `seconds`, [n]; None once it is over."""
        if seconds > self.duration:
            return None
        return np.array([np.interp(seconds, self.time, column) for column in self.q.T], np.float32)


@dataclass
class Recorder:
    """Records joint positions while it is told to. Safe to be told from several threads.

    `recordings`, those kept so far.
    """

    recordings: list[Recording] = field(default_factory=list)

    def __post_init__(self):
        self._samples: list[tuple[float, np.ndarray, np.ndarray]] | None = None
        self._target: np.ndarray | None = None
        self._lock = threading.Lock()

    @property
    def recording(self) -> bool:
        """Whether it records."""
        return self._samples is not None

    def begin(self, T_world_target: np.ndarray | None = None) -> None:
        """Record from now on, with the target at `T_world_target` [4, 4] or without. **Raises** `DemonstrationError` if
        other recordings have a target and this has none, or the other way round: all of a set need the same."""
        marked = [recording.T_world_target is not None for recording in self.recordings]
        if marked and marked[0] != (T_world_target is not None):
            raise DemonstrationError(
                f"the demonstrations so far have {'a' if marked[0] else 'no'} target frame and this one has "
                f"{'none' if marked[0] else 'one'}: all of a set need the same. Discard them, or "
                f"{'show' if marked[0] else 'hide'} the target frame."
            )
        with self._lock:
            self._samples = []
            self._target = None if T_world_target is None else np.array(T_world_target, float)

    def add(self, time: float, q: np.ndarray, hand: np.ndarray) -> None:
        """A sample at simulated `time`, s: joints `q` [n], and where the `hand` is [3], m; passed over unless it
        records and time has gone on."""
        with self._lock:
            if self._samples is not None and (not self._samples or time > self._samples[-1][0]):
                self._samples.append((time, np.array(q, float), np.array(hand, float)))

    def end(self) -> Recording:
        """Stop, and keep the recording. **Raises** `DemonstrationError` for one without motion, which is not kept."""
        with self._lock:
            samples, self._samples = self._samples or [], None
        if len(samples) < 2 or samples[-1][0] - samples[0][0] < _LEAST:
            raise DemonstrationError(f"that lasted less than {_LEAST} s and is not kept: record again.")
        time, q, hand = (np.stack(column) for column in zip(*samples, strict=True))
        if np.ptp(q, axis=0).max() < _MOVED:
            raise DemonstrationError("nothing moved in that recording, so it is not kept: drag the hand while it runs.")
        recording = Recording(time - time[0], q, hand, self._target)
        self.recordings.append(recording)
        return recording

    def discard(self, index: int) -> None:
        """Throw recording number `index` away. **Raises** `DemonstrationError` if there is none."""
        if not 0 <= index < len(self.recordings):
            raise DemonstrationError(f"there is no demonstration {index + 1}: {len(self.recordings)} are recorded.")
        del self.recordings[index]

    def save(self, robot: Robot, folder: Path, overwrite: bool = False) -> DemonstrationSet:
        """Write all, of `robot`, as `folder`, which `jaxrmp learn --demos` takes; poses are in the world of its file.

        **Raises** `DemonstrationError` for fewer than two, or, unless `overwrite`, if there are others there.
        """
        poses = [{} if r.T_world_target is None else {TARGET: r.T_world_target} for r in self.recordings]
        demonstrations = tuple(Demonstration(r.time, r.q, T) for r, T in zip(self.recordings, poses, strict=True))
        found = DemonstrationSet(demonstrations, robot.joint_names, robot.name, f"taught in the browser: {folder.name}")
        save_demonstrations(found, folder, overwrite=overwrite)
        return found
