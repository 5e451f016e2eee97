"""What gymnasium asks of environments."""

import warnings

import numpy as np
import pytest

from jaxrmp import ConfigurationError, ShapeError
from jaxrmp.environments import gymnasium_env, gymnasium_vector_env

gymnasium = pytest.importorskip("gymnasium", reason="needs gymnasium: pip install 'jaxrmp[gym]'")


def test_it_passes_gymnasiums_own_check(environment):
    from gymnasium.utils.env_checker import check_env

    with warnings.catch_warnings():
        warnings.filterwarnings("error", module="gymnasium")
        warnings.filterwarnings("ignore", message=".*(infinity|spec)")  # positions have no bounds; it is not registered
        check_env(gymnasium_env(environment), skip_render_check=True)


def test_many_at_once_are_those_of_one_and_begin_anew_with_the_next_step(environment):
    env, vector = gymnasium_env(environment), gymnasium_vector_env(environment, 4)
    for each in (env, vector):
        with pytest.raises(gymnasium.error.ResetNeeded, match="comes before"):
            each.step(each.action_space.sample())
    seen, _ = vector.reset(seed=3)
    again, _ = vector.reset(seed=3)
    assert (seen == again).all() and seen.shape == vector.observation_space.shape == (4, 13)
    assert vector.metadata["autoreset_mode"] is gymnasium.vector.AutoresetMode.NEXT_STEP
    listed, _ = vector.reset(seed=[1, None, 1, 2])
    assert (listed[0] == listed[2]).all() and (listed[0] != listed[1]).any()
    np.testing.assert_allclose(listed[3], env.reset(seed=2)[0], atol=1e-5)
    np.testing.assert_allclose(again[2], env.reset(seed=5)[0], atol=1e-5)
    with pytest.raises(ShapeError, match="list of 3, expected one for each of 4"):
        vector.reset(seed=[1, 2, 3])
    rewards, ends = [], []
    for _ in range(environment.length + 1):
        seen, reward, terminated, truncated, info = vector.step(vector.action_space.sample() * 0)
        rewards.append(reward)
        ends.append(terminated | truncated)
    assert ends[-2].all() and not np.any(ends[:-2]) and not ends[-1].any()
    assert (rewards[-1] == 0).all() and not info["_distance"].any()
    env.reset(seed=0)
    assert env.step(np.zeros(3, np.float32))[4]["distance"] > 0.4
    with pytest.raises(ConfigurationError, match="count is 0"):
        gymnasium_vector_env(environment, 0)


def test_actions_that_are_none_are_refused_and_change_nothing(environment):
    for env, name, shape in [
        (gymnasium_env(environment), "action", (3,)),
        (gymnasium_vector_env(environment, 2), "actions", (2, 3)),
    ]:
        env.reset(seed=0)
        with pytest.raises(ShapeError, match=rf"{name} has shape \(4,\), expected"):
            env.step(np.zeros(4))
        with pytest.raises(ConfigurationError, match=rf"{name}\[0.*\] of step is nan, expected a finite number"):
            env.step(np.full(shape, np.nan))
        assert np.isfinite(env.step(np.zeros(shape))[0]).all()
