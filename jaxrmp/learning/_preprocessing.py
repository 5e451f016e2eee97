"""From joint trajectories as recorded to smooth ones with the same geometry and an even number of samples."""

from typing import Literal, NamedTuple, get_args

import numpy as np

from .._errors import ConfigurationError, DemonstrationError, UnknownNameError, importing
from .._ranges import BelowOne, NonNegative, Positive, settings
from ._arc_length import cubic_spline, resample_by_arc_length
from ._demonstrations import Demonstration, DemonstrationSet

Resampling = Literal["arc", "time"]

_MOST_SAMPLES = 1_000_000  # on the even time grid: nine hours at 30 Hz


@settings("preprocessing")
class PreprocessingSettings:
    """How `preprocess` works. Durations in seconds.

    `samples`: points per trajectory. `resample`: even in joint arc length, or even in time as in the paper.
    `filter_window`, `filter_order`: of the Savitzky-Golay filter. `rate`: of the even time grid, 1/s.
    `repeat`: samples closer than this are merged into their mean. `gap`: a longer step counts as a gap.
    `static_speed`: below this fraction of the median moving joint speed the arm stands still. `static_duration`:
    pauses longer than this are dropped. `min_motion`: largest joint excursion that does not count as motion, rad or m.

    **Raises** `ConfigurationError` or `UnknownNameError` for a value that makes no sense.
    """

    samples: int = 200
    resample: Resampling = "arc"
    filter_window: Positive[float] = 0.35
    filter_order: int = 3
    rate: Positive[float] = 30.0
    repeat: NonNegative[float] = 0.005
    gap: Positive[float] = 0.1
    static_speed: BelowOne[NonNegative[float]] = 0.02
    static_duration: Positive[float] = 0.3
    min_motion: Positive[float] = 0.02

    def __post_init__(self):
        UnknownNameError.check("resampling", self.resample, get_args(Resampling))
        if self.samples < 4:
            raise ConfigurationError(f"samples is {self.samples!r}, expected at least 4.")
        if not 1 <= self.filter_order < self.window_samples:
            raise ConfigurationError(
                f"filter_window {self.filter_window} s is {self.window_samples} samples at rate {self.rate}, too short "
                f"for filter_order {self.filter_order} (at least 1). Make the window longer."
            )

    @property
    def window_samples(self) -> int:
        """The filter window on the even time grid, an odd number of samples."""
        return 2 * round(self.filter_window * self.rate / 2 - 0.5) + 1


class PreprocessingReport(NamedTuple):
    """What was found in one demonstration and done about it. Durations in seconds, speeds in rad/s (or m/s).

    `samples_read`; `repeats_merged`, samples; `gaps`, how many, and `largest_gap`; `duration`; `trimmed_start` and
    `trimmed_end`; `pauses_dropped`, how many, and `pause_seconds_dropped`; `static_speed`, below which the arm pauses;
    `median_speed` while it moves; `path_length`, rad (or m); `pauses`, of those dropped in between, when each began in
    the recording and how long it was.
    """

    samples_read: int
    repeats_merged: int
    gaps: int
    largest_gap: float
    duration: float
    trimmed_start: float
    trimmed_end: float
    pauses_dropped: int
    pause_seconds_dropped: float
    static_speed: float
    median_speed: float
    path_length: float
    pauses: tuple[tuple[float, float], ...] = ()

    @property
    def paused(self) -> str:
        """When it paused and for how long, in words, empty if it did not."""
        return ", ".join(f"{seconds:.1f} s from {at:.1f} s on" for at, seconds in self.pauses)


class Preprocessed(NamedTuple):
    """Trajectories `q`, N arrays [samples, n] in rad or m, and one of `reports` for each; `timed`, N arrays [S, n], the
    same before they were resampled, and `times`, N arrays [S], s since they began to move, pauses left out."""

    q: tuple[np.ndarray, ...]
    reports: tuple[PreprocessingReport, ...]
    timed: tuple[np.ndarray, ...]
    times: tuple[np.ndarray, ...]

    def in_time(self, samples: int) -> tuple[np.ndarray, np.ndarray]:
        """`samples` times even from start to end of each trajectory, s, and joints then: [N, samples] and with n."""
        at = np.stack([np.linspace(0, time[-1], samples) for time in self.times])
        return at, np.stack([cubic_spline(*way) for way in zip(self.times, self.timed, at, strict=True)])


def preprocess(demonstrations: DemonstrationSet, settings: PreprocessingSettings | None = None) -> Preprocessed:
    """Make each of `demonstrations` a smooth joint trajectory of `settings.samples` points, keeping its geometry.

    Repeated stamps are merged, the rest put on an even time grid, pauses dropped (those at the ends become the one
    configuration in which the arm rested), the joints smoothed by a Savitzky-Golay filter that leaves the two end
    points where they are, and resampled by a cubic spline.

    **Arguments**: `settings`, by default `PreprocessingSettings()`. **Returns** a `Preprocessed`.
    **Raises** `DemonstrationError` if a demonstration is without motion or moves for less than the filter window;
    `MissingDependencyError` without scipy.

    Rana et al. 2019, section 4, which resamples evenly in time; since only geometry is learned, arc length is the
    default here.
    """
    settings = settings or PreprocessingSettings()
    results = [_preprocess_one(d, settings, f"demonstration {k}") for k, d in enumerate(demonstrations)]
    return Preprocessed(*(tuple(column) for column in zip(*results, strict=True)))


def merge_repeats(time: np.ndarray, q: np.ndarray, repeat: float = 0.005) -> tuple[np.ndarray, np.ndarray]:
    """Merge samples that follow their group's first within `repeat` seconds into their mean: `time` [S], `q` [S, n]."""
    group, first, number = np.zeros(len(time), int), time[0], 0
    for i, t in enumerate(time[1:], start=1):
        if t - first > repeat:
            first, number = t, number + 1
        group[i] = number
    count = np.bincount(group)
    merged = np.stack([np.bincount(group, weights=column) / count for column in q.T], axis=1)
    return np.bincount(group, weights=time) / count, merged


def even_grid(time: np.ndarray, q: np.ndarray, rate: float) -> np.ndarray:
    """Interpolate `q` [T, n] at strictly increasing `time` onto an even grid from first to last stamp: [S, n].

    Piecewise cubic without overshoot, so that a gap adds no swing.
    """
    interpolate = _scipy("interpolate")
    steps = max(round((time[-1] - time[0]) * rate), 1)
    return interpolate.PchipInterpolator(time, q, axis=0)(np.linspace(time[0], time[-1], steps + 1))


def smooth(q: np.ndarray, window: int, order: int) -> np.ndarray:
    """Savitzky-Golay filter along time, q [T, n], with the ends reflected through the end points, which stay put."""
    signal, half = _scipy("signal"), window // 2
    padded = np.concatenate([2 * q[0] - q[half:0:-1], q, 2 * q[-1] - q[-2 : -half - 2 : -1]])
    return signal.savgol_filter(padded, window, order, axis=0)[half:-half]


def joint_speed(q: np.ndarray, window: int, order: int, rate: float) -> np.ndarray:
    """Smoothed speed |dq/dt| [T] of a trajectory on an even grid, in units of q per second."""
    velocity = _scipy("signal").savgol_filter(q, window, order, deriv=1, delta=1.0 / rate, axis=0, mode="interp")
    return np.linalg.norm(velocity, axis=1)


def pauses(still: np.ndarray, least: int) -> list[tuple[int, int]]:
    """Half-open runs of at least `least` samples in which `still` [T] holds."""
    edges = np.diff(np.concatenate([[0], still.astype(int), [0]]))
    runs = zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True)
    return [(int(a), int(b)) for a, b in runs if b - a >= least]


def _preprocess_one(
    demonstration: Demonstration, settings: PreprocessingSettings, where: str
) -> tuple[np.ndarray, PreprocessingReport, np.ndarray, np.ndarray]:
    window, order, rate = settings.window_samples, settings.filter_order, settings.rate
    time, q = merge_repeats(demonstration.time, demonstration.q, settings.repeat)
    steps = np.diff(time)
    excursion = np.ptp(q, axis=0).max()
    if excursion < settings.min_motion:
        raise DemonstrationError(
            f"{where} is without motion: no joint moves by more than {excursion:.2g} (rad or m), expected at least "
            f"{settings.min_motion:g}. Leave it out, or record it again."
        )
    _check_length(time[-1] - time[0], rate, window, where, "lasts")
    if (time[-1] - time[0]) * rate > _MOST_SAMPLES:
        raise DemonstrationError(f"{where} lasts {time[-1] - time[0]:.3g} s: are its time stamps in seconds?")
    grid = even_grid(time, q, rate)
    speed = joint_speed(grid, window, order, rate)
    median = float(np.median(speed[speed > 0.1 * np.percentile(speed, 99)]))
    still = speed < settings.static_speed * median
    stretches = pauses(still, max(round(settings.static_duration * rate), 1))
    moving, start, end, inner = _drop_pauses(grid, stretches, window)
    _check_length((len(moving) - 1) / rate, rate, window, where, "without its pauses lasts")
    timed = trajectory = smooth(moving, window, order)
    step = (time[-1] - time[0]) / (len(grid) - 1)
    if settings.resample == "arc":
        trajectory = resample_by_arc_length(trajectory, settings.samples, "cubic")
    else:
        even = np.linspace(0, len(trajectory) - 1, settings.samples)
        trajectory = cubic_spline(np.arange(len(trajectory)), trajectory, even)
    report = PreprocessingReport(
        samples_read=len(demonstration.time),
        repeats_merged=len(demonstration.time) - len(time),
        gaps=int((steps > settings.gap).sum()),
        largest_gap=float(steps.max()),
        duration=float(time[-1] - time[0]),
        trimmed_start=start / rate,
        trimmed_end=end / rate,
        pauses_dropped=len(inner),
        pause_seconds_dropped=sum(b - a for a, b in inner) / rate,
        static_speed=settings.static_speed * median,
        median_speed=median,
        path_length=float(np.linalg.norm(np.diff(trajectory, axis=0), axis=1).sum()),
        pauses=tuple((float(time[0] - demonstration.time[0] + a * step), (b - a) * step) for a, b in inner),
    )
    return trajectory, report, timed, step * np.arange(len(timed))


def _drop_pauses(
    q: np.ndarray, stretches: list[tuple[int, int]], window: int
) -> tuple[np.ndarray, int, int, list[tuple[int, int]]]:
    """What is left of `q`, the samples trimmed at start and end, and the pauses dropped in between.

    A pause at an end leaves one sample: where the arm rested at the very start or end, averaged over a filter window.
    """
    starts = bool(stretches) and stretches[0][0] == 0
    ends = bool(stretches) and stretches[-1][1] == len(q)
    keep = np.ones(len(q), bool)
    for a, b in stretches:
        keep[a:b] = False
    parts, trimmed_start, trimmed_end = [q[keep]], 0, 0
    if starts:
        trimmed_start = stretches[0][1]
        parts.insert(0, q[: min(trimmed_start, window)].mean(axis=0, keepdims=True))
    if ends:
        trimmed_end = len(q) - stretches[-1][0]
        parts.append(q[-min(trimmed_end, window) :].mean(axis=0, keepdims=True))
    inner = stretches[int(starts) : len(stretches) - int(ends)]
    return np.concatenate(parts), trimmed_start, trimmed_end, inner


def _check_length(seconds: float, rate: float, window: int, where: str, verb: str) -> None:
    if seconds * rate < window - 0.5:
        raise DemonstrationError(
            f"{where} {verb} {seconds:.3g} s, shorter than the filter window of {window / rate:.3g} s. Leave it "
            "out, or make filter_window shorter."
        )


def _scipy(module: str):
    with importing("scipy", "learning"):
        import scipy.interpolate
        import scipy.signal
    return getattr(scipy, module)
