"""The tracker: its rate, noise, delay, drop-outs and silence."""

import numpy as np
import pytest

from jaxrmp import ConfigurationError, simulation
from jaxrmp.simulation import PERFECT, TrackerSettings, observe, start_tracker


def moving(t):
    T = np.eye(4)
    T[0, 3] = t
    return T


def watch(settings, seconds, seed=(0, 0), dt=0.001):
    state, states = start_tracker(settings, seed, moving(0.0)), []
    for k in range(round(seconds / dt)):
        state = observe(settings, state, k * dt, moving(k * dt))
        states.append(state)
    return states


def test_a_perfect_tracker_sees_the_truth_thirty_times_a_second():
    seen = np.array([s.seen[0, 3] for s in watch(PERFECT, 2.0)])
    assert len(np.unique(seen)) == 60
    time = 0.001 * np.arange(2000)
    assert (time - seen >= -1e-9).all() and (time - seen).max() < 1 / 30 + 0.001


def test_delay_holds_frames_back():
    late = TrackerSettings(jitter=(0, 0), drift=(0, 0), delay=0.1)
    seen = np.array([s.seen[0, 3] for s in watch(late, 1.0)])
    lag = 0.001 * np.arange(1000) - seen
    assert lag[200:].min() >= 0.1 - 1e-9 and lag[200:].max() < 0.1 + 1 / 30 + 0.002


def test_drop_outs_lose_their_share_of_frames():
    settings = TrackerSettings(jitter=(0, 0), drift=(0, 0), dropouts=0.4)
    frames = len(np.unique([s.stamp for s in watch(settings, 20.0, dt=0.01)]))
    assert 0.5 * 600 < frames < 0.7 * 600


def test_noise_has_the_stated_size_and_the_seed_decides():
    settings = TrackerSettings()
    state, errors = start_tracker(settings, (3, 1), np.eye(4)), []
    for k in range(6000):
        state = observe(settings, state, k / 30, np.eye(4))
        errors.append([*state.seen[:3, 3], state.seen[2, 1], state.seen[0, 2], state.seen[1, 0]])
    errors = np.array(errors)
    expected = np.hypot(settings.drift, settings.jitter)
    np.testing.assert_allclose(errors[:, :3].std(), expected[0], rtol=0.25)
    np.testing.assert_allclose(errors[:, 3:].std(), expected[1], rtol=0.25)
    np.testing.assert_allclose(np.diff(errors[:, :3], axis=0).std(), np.sqrt(2) * settings.jitter[0], rtol=0.3)
    R = state.seen[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
    again = watch(settings, 0.5, (5, 5))[-1].seen
    np.testing.assert_array_equal(again, watch(settings, 0.5, (5, 5))[-1].seen)
    assert not np.allclose(again, watch(settings, 0.5, (5, 6))[-1].seen)


def test_bias_stays():
    settings = TrackerSettings(jitter=(0, 0), drift=(0, 0), bias=0.01)
    state, seen = start_tracker(settings, (1, 1), np.eye(4)), []
    for k in range(300):
        state = observe(settings, state, k / 30, np.eye(4))
        seen.append(state.seen[:3, 3])
    assert np.ptp(seen, axis=0).max() < 1e-12 and np.linalg.norm(seen[0]) > 1e-3


def test_silence_is_noticed_after_the_stated_time():
    settings = TrackerSettings(jitter=(0, 0), drift=(0, 0), silent_after=1.0, keep=0.3, delay=0.1)
    states = watch(settings, 2.0)
    gone = [settings.age(s, 0.001 * k) > settings.keep for k, s in enumerate(states)]
    assert not any(gone[:1350]) and all(gone[1450:])


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"rate": 0.0}, "tracker.rate is 0.0"),
        ({"jitter": (1.0,)}, "tracker.jitter is"),
        ({"delay": -1.0}, "tracker.delay is -1.0"),
        ({"dropouts": 1.0}, "tracker.dropouts is 1.0"),
        ({"silent_after": float("nan")}, "tracker.silent_after is nan"),
    ],
)
def test_mistakes_are_explained(changed, message):
    with pytest.raises(ConfigurationError, match=message):
        simulation.TrackerSettings(**changed)
