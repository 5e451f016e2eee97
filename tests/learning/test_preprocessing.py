"""Preprocessing keeps the geometry and takes away the rest."""

import numpy as np
import pytest

from jaxrmp import ConfigurationError, DemonstrationError, ShapeError, UnknownNameError
from jaxrmp.learning._arc_length import resample_by_arc_length
from jaxrmp.learning._demonstrations import Demonstration, DemonstrationSet
from jaxrmp.learning._preprocessing import (
    PreprocessingSettings,
    even_grid,
    merge_repeats,
    pauses,
    preprocess,
    smooth,
)
from jaxrmp.learning._subtask_trajectories import (
    end_spread,
    subtask_trajectories,
    tapered_speed,
    unit_directions,
)

RATE = 30.0


def curve(s):
    """A smooth planar curve for s in [0, 1]."""
    return np.stack([np.sin(2.0 * s), np.cos(3.0 * s)], axis=-1)


def pace(samples):
    s = np.linspace(0.0, 1.0, samples)
    return s**2 * (3.0 - 2.0 * s)


def demonstrations(*recordings):
    return DemonstrationSet(tuple(Demonstration(time, q) for time, q in recordings), ("a", "b"))


def plain(samples=150):
    return np.arange(samples) / RATE, curve(pace(samples))


def with_trouble(seed=0):
    """The same motion, with rests at both ends, a pause within, jitter, repeats, a gap and noise."""
    rng = np.random.default_rng(seed)
    time, q = plain()
    q = np.concatenate(
        [np.repeat(q[:1], 200, 0), q[:70], np.repeat(q[70:71], 60, 0), q[70:], np.repeat(q[-1:], 300, 0)]
    )
    time = np.arange(len(q)) / RATE
    q = q + rng.normal(0.0, 2e-5, q.shape)
    time = np.sort(time + rng.normal(0.0, 1e-3, len(time)))
    time[240] = time[241] - 1e-6
    keep = np.ones(len(q), bool)
    keep[375:381] = False
    return time[keep], q[keep]


def distance_to_curve(q):
    return np.linalg.norm(q[:, None] - curve(np.linspace(0.0, 1.0, 2000)), axis=-1).min(axis=1).max()


@pytest.mark.parametrize("resample", ["arc", "time"])
def test_pauses_repeats_gaps_and_jitter_leave_the_geometry(resample):
    settings = PreprocessingSettings(resample=resample)
    result = preprocess(demonstrations(plain(), with_trouble()), settings)
    for q in result.q:
        assert q.shape == (200, 2)
        assert distance_to_curve(q) < 2e-3
        np.testing.assert_allclose(q[[0, -1]], curve(np.array([0.0, 1.0])), atol=1e-3)
    if resample == "arc":
        assert np.abs(result.q[0] - result.q[1]).max() < 0.02  # of a path of 3.5; the pause begins abruptly


def test_the_report_says_what_was_found():
    clean, trouble = preprocess(demonstrations(plain(), with_trouble())).reports
    assert (clean.repeats_merged, clean.gaps, clean.pauses_dropped) == (0, 0, 0)
    assert clean.duration == pytest.approx(149 / RATE)
    assert (trouble.repeats_merged, trouble.gaps, trouble.pauses_dropped) == (1, 1, 1)
    assert trouble.largest_gap == pytest.approx(7 / RATE, abs=0.01)
    assert trouble.trimmed_start == pytest.approx(200 / RATE, abs=0.4)
    assert trouble.trimmed_end == pytest.approx(300 / RATE, abs=0.4)
    assert trouble.pause_seconds_dropped == pytest.approx(2.0, abs=0.4)
    assert trouble.path_length == pytest.approx(clean.path_length, rel=0.01)


def test_arc_resampling_is_even():
    q = preprocess(demonstrations(plain(), plain())).q[0]
    steps = np.linalg.norm(np.diff(q, axis=0), axis=1)
    assert np.ptp(steps) < 0.01 * steps.mean()


def test_a_pause_at_an_end_leaves_the_resting_configuration():
    time, q = with_trouble()
    processed = preprocess(demonstrations(plain(), (time, q))).q[1]
    np.testing.assert_allclose(processed[-1], q[-11:].mean(axis=0), atol=1e-4)


def test_a_demonstration_without_motion_is_refused():
    time, q = plain()
    with pytest.raises(DemonstrationError, match="demonstration 1 is without motion: no joint moves by more than"):
        preprocess(demonstrations((time, q), (time, np.ones_like(q) + 1e-3 * q)))


def test_a_demonstration_shorter_than_the_filter_window_is_refused():
    time, q = plain(150)
    with pytest.raises(
        DemonstrationError, match=r"demonstration 1 lasts 0.3 s, shorter than the filter window of 0.367"
    ):
        preprocess(demonstrations((time, q), (time[:10], 10 * q[:10])))
    still = np.repeat(q[:1], 100, 0)
    burst = np.concatenate([still, q[:4] + [[0, 0], [0.1, 0], [0.2, 0], [0.3, 0]], still + [0.3, 0.0]])
    settings = PreprocessingSettings(filter_window=1.2, static_speed=0.9)
    with pytest.raises(DemonstrationError, match="without its pauses lasts"):
        preprocess(demonstrations((np.arange(204) / RATE, burst), (time, q)), settings)


def test_time_stamps_in_nanoseconds_are_noticed():
    time, q = plain()
    with pytest.raises(DemonstrationError, match="are its time stamps in seconds"):
        preprocess(demonstrations((1e9 * time, q), (time, q)))


@pytest.mark.parametrize(
    ("setting", "error", "message"),
    [
        ({"resample": "arcs"}, UnknownNameError, "Did you mean 'arc'"),
        ({"rate": 0.0}, ConfigurationError, "rate is 0.0, expected a positive"),
        ({"samples": 3}, ConfigurationError, "samples is 3, expected at least 4"),
        ({"static_speed": 1.0}, ConfigurationError, "static_speed is 1.0, expected a number below one"),
        ({"filter_window": 0.05}, ConfigurationError, "too short for filter_order 3"),
    ],
)
def test_senseless_settings_are_refused(setting, error, message):
    with pytest.raises(error, match=message):
        PreprocessingSettings(**setting)


def test_repeats_are_merged_into_their_mean():
    time, q = merge_repeats(np.array([0.0, 1.0, 1.0, 1.001, 2.0]), np.array([[0.0], [1.0], [2.0], [6.0], [4.0]]))
    np.testing.assert_allclose(time, [0.0, 3.001 / 3, 2.0])
    np.testing.assert_allclose(q, [[0.0], [3.0], [4.0]])


def test_the_grid_is_even_and_does_not_overshoot():
    q = even_grid(np.array([0.0, 0.1, 0.5, 0.6]), np.array([[0.0], [0.0], [1.0], [1.0]]), 10.0)
    assert q.shape == (7, 1)
    assert q.min() >= 0.0 and q.max() <= 1.0


def test_the_filter_keeps_cubics_and_end_points():
    t = np.linspace(-1.0, 1.0, 50)
    q = np.stack([t**3 - t, t**2], axis=1)
    filtered = smooth(q, 11, 3)
    np.testing.assert_allclose(filtered[5:-5], q[5:-5], atol=1e-12)
    np.testing.assert_allclose(filtered[[0, -1]], q[[0, -1]], atol=1e-12)


def test_pauses_are_runs_of_a_least_length():
    assert pauses(np.array([1, 1, 0, 1, 0, 1, 1, 1], bool), 2) == [(0, 2), (5, 8)]
    assert pauses(np.zeros(3, bool), 1) == []


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_arc_length_resampling_ignores_speed_and_pauses(interpolation):
    s = np.sort(np.concatenate([np.linspace(0.0, 1.0, 400) ** 2, np.full(50, 0.3)]))
    a = resample_by_arc_length(curve(np.linspace(0.0, 1.0, 800)), 50, interpolation)
    b = resample_by_arc_length(curve(s), 50, interpolation)
    np.testing.assert_allclose(a, b, atol=1e-3)
    np.testing.assert_array_equal(a[[0, -1]], curve(np.array([0.0, 1.0])))


def test_arc_length_resampling_of_small_cases():
    corner = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 3.0]])
    np.testing.assert_allclose(resample_by_arc_length(corner, 5), [[0, 0], [1, 0], [1, 1], [1, 2], [1, 3]])
    np.testing.assert_array_equal(resample_by_arc_length(np.ones((4, 2)), 3), np.ones((3, 2)))
    assert resample_by_arc_length(np.zeros((4, 2, 3)), 6).shape == (6, 2, 3)
    with pytest.raises(ShapeError, match="expected"):
        resample_by_arc_length(np.zeros((0, 2)), 3)
    with pytest.raises(UnknownNameError, match="interpolation 'quintic'"):
        resample_by_arc_length(curve(np.linspace(0, 1, 9)), 3, "quintic")


def lines(ends, samples=40):
    """Straight control-point paths, two points each, that come from different sides."""
    s = np.linspace(0.0, 1.0, samples)[:, None, None] ** 2
    starts = np.array([[[0.4, 0.0, 0.0], [0.4, 0.1, 0.0]], [[0.0, 0.4, 0.0], [0.0, 0.5, 0.1]]])
    return [(1 - s) * start + s * np.asarray(end) for start, end in zip(starts, ends, strict=True)]


ENDS = np.array([[[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]], [[0.02, 0.0, 0.0], [0.12, 0.0, 0.0]]])


def test_subtask_trajectories_of_straight_lines():
    result = subtask_trajectories(lines(ENDS), samples=50, taper=0.03)
    assert result.positions.shape == result.directions.shape == result.velocities.shape == (2, 2, 50, 3)
    np.testing.assert_allclose(result.positions[:, :, -1], 0.0, atol=1e-15)
    np.testing.assert_allclose(result.ends, ENDS)
    np.testing.assert_allclose(result.targets, ENDS.mean(axis=0))
    toward = -result.positions[:, :, :-1] / np.linalg.norm(result.positions[:, :, :-1], axis=-1, keepdims=True)
    np.testing.assert_allclose(result.directions[:, :, :-1], toward, atol=1e-9)
    speed = np.linalg.norm(result.velocities, axis=-1)
    np.testing.assert_allclose(speed, np.tanh(np.linalg.norm(result.positions, axis=-1) / 0.03), atol=1e-12)
    assert (speed[..., -1] == 0).all() and (speed[..., 0] > 0.99).all()


def test_ends_may_be_aligned_in_the_mean_only():
    result = subtask_trajectories(lines(ENDS), align="mean", resample="time", samples=40)
    np.testing.assert_allclose(result.positions[0, :, -1], [[-0.01, 0, 0], [0.01, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(result.positions[0, 0] + result.targets[0], lines(ENDS)[0][:, 0])


def test_ends_further_apart_than_the_tolerance_are_refused():
    apart = ENDS + [[[0.0] * 3], [[0.3, 0.0, 0.0]]]
    np.testing.assert_allclose(end_spread(lines(apart)), 0.16, atol=1e-12)
    with pytest.raises(DemonstrationError, match=r"demonstration \d ends 16.0 cm from .* allowed 8.0 cm"):
        subtask_trajectories(lines(apart))
    subtask_trajectories(lines(apart), end_tolerance=0.2)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"align": "ends"}, UnknownNameError, "alignment 'ends'"),
        ({"resample": "even"}, UnknownNameError, "resampling 'even'"),
        ({"taper": -1.0}, ConfigurationError, "taper is -1.0"),
        ({"points": lines(ENDS)[:1]}, DemonstrationError, "at least two"),
        ({"points": [np.zeros((5, 2, 3)), np.zeros((5, 1, 3))]}, ShapeError, "expected"),
        ({"points": [np.zeros((5, 1, 3)), np.zeros((5, 1, 3))]}, DemonstrationError, "does not move"),
    ],
)
def test_unfit_control_points_are_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        subtask_trajectories(**({"points": lines(ENDS)} | arguments))


def test_directions_where_a_path_stands_still():
    x = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    directions = unit_directions(x)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    np.testing.assert_allclose(directions[[0, 2, 4]], [[1, 0], [1, 0], [0, 1]])


def test_no_taper_means_unit_speed():
    np.testing.assert_array_equal(tapered_speed(np.zeros((4, 3)), 0.0), np.ones(4))
