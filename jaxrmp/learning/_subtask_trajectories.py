"""Control-point trajectories as the learning steps want them: target at the origin, directions, target velocities."""

from collections.abc import Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np

from .._errors import ConfigurationError, DemonstrationError, ShapeError, UnknownNameError
from ._arc_length import resample_by_arc_length

Alignment = Literal["each", "mean"]


class SubtaskTrajectories(NamedTuple):
    """N demonstrations of K control points at T samples, in the object's frame, m.

    `positions` [K, N, T, 3], the target at the origin; `directions` [K, N, T, 3], unit; `velocities` [K, N, T, 3],
    directions times a target speed (of unit one) that falls to zero at the origin; `targets` [K, 3], the common end
    point in the object's frame; `ends` [N, K, 3], where each demonstration ends in that frame.
    """

    positions: np.ndarray
    directions: np.ndarray
    velocities: np.ndarray
    targets: np.ndarray
    ends: np.ndarray


def subtask_trajectories(
    points: Sequence[np.ndarray],
    *,
    samples: int = 200,
    resample: Literal["arc", "time"] = "arc",
    align: Alignment = "each",
    taper: float = 0.03,
    end_tolerance: float = 0.08,
) -> SubtaskTrajectories:
    """Positions, directions and target velocities of each control point, with its target at the origin.

    The velocity wanted at x is `v tanh(|x| / taper)`, v the unit direction of motion: a field with unit speed up to
    the very end would need a metric that vanishes at the goal.

    **Arguments**: `points`, N arrays [T, K, 3] in the object's frame, m; `samples`, T of the result; `resample`,
    `arc` samples every point evenly along its own path, `time` keeps the given parametrisation, with all K points at
    the same instants; `align`, whether `each` demonstration's end is moved to the origin or the `mean` of all ends;
    `taper`, m (0 for unit speed everywhere); `end_tolerance`, m.
    **Returns** a `SubtaskTrajectories`.
    **Raises** `DemonstrationError` if a demonstration ends further than `end_tolerance` from the mean of all ends, or
    a control point does not move; `ShapeError` if the shapes do not fit together.

    Rana et al. 2019, sections 3 and 4.
    """
    UnknownNameError.check("alignment", align, get_args(Alignment))
    UnknownNameError.check("resampling", resample, ("arc", "time"))
    if not (taper >= 0 and end_tolerance > 0):
        raise ConfigurationError(f"taper is {taper!r} and end_tolerance {end_tolerance!r}: expected lengths, m.")
    points = [np.asarray(path, float) for path in points]
    if len(points) < 2:
        raise DemonstrationError(f"received control points of {len(points)} demonstration(s), expected at least two.")
    shapes = [path.shape for path in points]
    if any(len(shape) != 3 or shape[0] < 2 or shape[1:] != shapes[0][1:] for shape in shapes):
        raise ShapeError(f"control points have shapes {shapes}, expected [T, K, 3] with one K.")
    spread = end_spread(points)
    if spread.max() > end_tolerance:
        n, k = np.unravel_index(spread.argmax(), spread.shape)
        raise DemonstrationError(
            f"demonstration {n} ends {100 * spread[n, k]:.1f} cm from the mean of all ends (control point {k}), "
            f"allowed {100 * end_tolerance:.1f} cm. Leave it out, choose the frame of the object that the skill is "
            "about, or raise end_tolerance."
        )
    ends = np.stack([path[-1] for path in points])
    targets = ends.mean(axis=0)
    positions = np.stack([_resampled(path, samples, resample) for path in points])
    positions = positions - (ends if align == "each" else np.broadcast_to(targets, ends.shape))[:, None]
    positions = np.ascontiguousarray(positions.transpose(2, 0, 1, 3))
    directions = unit_directions(positions)
    velocities = directions * tapered_speed(positions, taper)[..., None]
    return SubtaskTrajectories(positions, directions, velocities, targets, ends)


def end_spread(points: Sequence[np.ndarray]) -> np.ndarray:
    """Distance of every demonstration's end from the mean of all ends, per control point: [N, K], m."""
    ends = np.stack([np.asarray(path)[-1] for path in points])
    return np.linalg.norm(ends - ends.mean(axis=0), axis=-1)


def unit_directions(x: np.ndarray) -> np.ndarray:
    """Unit direction of motion along paths [..., T, m], by central differences.

    Where a path stands still it has none: there the nearest moving sample's is taken.

    **Raises** `DemonstrationError` if a path does not move at all.
    """
    x = np.asarray(x, float)
    change = np.gradient(x, axis=-2)
    length = np.linalg.norm(change, axis=-1)
    flat, lengths = change.reshape(-1, *x.shape[-2:]), length.reshape(-1, x.shape[-2])
    directions = np.empty_like(flat)
    for i, (steps, size) in enumerate(zip(flat, lengths, strict=True)):
        moving = np.flatnonzero(size > 1e-6 * size.max())
        if moving.size == 0 or size.max() < 1e-12:
            where = np.unravel_index(i, x.shape[:-2])
            raise DemonstrationError(
                f"path {tuple(int(n) for n in where)} (control point, demonstration) does not move."
            )
        nearest = moving[np.abs(np.arange(len(steps))[:, None] - moving).argmin(axis=1)]
        directions[i] = steps[nearest] / size[nearest, None]
    return directions.reshape(x.shape)


def tapered_speed(x: np.ndarray, taper: float = 0.03) -> np.ndarray:
    """Target speed `tanh(|x| / taper)` at distance |x| from the goal, [...] for x [..., m]; 1 if `taper` is 0."""
    distance = np.linalg.norm(x, axis=-1)
    return np.ones_like(distance) if taper == 0 else np.tanh(distance / taper)


def _resampled(path: np.ndarray, samples: int, resample: str) -> np.ndarray:
    if resample == "arc":
        return np.stack([resample_by_arc_length(path[:, k], samples, "cubic") for k in range(path.shape[1])], axis=1)
    if len(path) == samples:
        return path
    at, old = np.linspace(0.0, 1.0, samples), np.linspace(0.0, 1.0, len(path))
    columns = [np.interp(at, old, column) for column in path.reshape(len(path), -1).T]
    return np.stack(columns, axis=1).reshape(samples, *path.shape[1:])
