"""Human-like motions of the hand: overlapping minimum-jerk segments from via point to via point."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._errors import importing

with importing("scipy", "learning"):
    from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class HandMotion:
    """A motion of the hand through S + 1 via poses, at rest at both ends.

    `positions` [S + 1, 3], m, and `rotations` [S + 1] of the hand in the base; `starts` and `durations` [S] of the
    segments, s. `wobble` [H, 6], amplitudes of H slow harmonics of position (m) and rotation (rad), the variation
    that no two human motions share; it vanishes at both ends and fades during the last segment.
    """

    positions: np.ndarray
    rotations: Rotation
    starts: np.ndarray
    durations: np.ndarray
    wobble: np.ndarray

    @property
    def duration(self) -> float:
        """From the first segment's start to the last one's end, s."""
        return float((self.starts + self.durations).max())

    def __call__(self, t: np.ndarray) -> tuple[np.ndarray, Rotation]:
        """Positions [T, 3] and rotations [T] at times `t` [T], s."""
        s = minimum_jerk((t[:, None] - self.starts) / self.durations)
        position = self.positions[0] + s @ np.diff(self.positions, axis=0)
        rotation = self.rotations[0]
        for i, turn in enumerate((self.rotations[:-1].inv() * self.rotations[1:]).as_rotvec()):
            rotation = rotation * Rotation.from_rotvec(s[:, i, None] * turn)
        phase = np.pi * np.arange(1, len(self.wobble) + 1) * t[:, None] / self.duration
        wobble = (s[:, :1] * (1.0 - s[:, -1:])) * (np.sin(phase) @ self.wobble)
        return position + wobble[:, :3], rotation * Rotation.from_rotvec(wobble[:, 3:])


def through(
    positions: Sequence, rotations: Sequence[Rotation], speed: float, overlap: float, rng: np.random.Generator
) -> HandMotion:
    """A motion through via poses at about `speed`, m/s, with a wobble of three harmonics, falling with their frequency.

    Every segment begins when `overlap` (a fraction) of the one before is still to come, which rounds the corners.
    """
    wobble = rng.normal(0.0, 1.0, (3, 6)) * ([0.008] * 3 + [0.03] * 3) / np.array([[1.0], [2.0], [3.0]])  # m and rad
    lengths = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    durations = np.maximum(lengths / speed, 0.8)
    starts = np.concatenate([[0.0], np.cumsum(durations[:-1] * (1.0 - overlap))])
    return HandMotion(np.stack(positions), Rotation.concatenate(rotations), starts, durations, wobble)


def minimum_jerk(s: np.ndarray) -> np.ndarray:
    """`10 s^3 - 15 s^4 + 6 s^5` on [0, 1], constant outside: rest to rest with least jerk (Flash and Hogan 1985)."""
    s = np.clip(s, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
