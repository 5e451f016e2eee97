"""A `ResidualEnvironment` as gymnasium has environments: one, and many at once."""

from typing import Any

import gymnasium
import jax
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector.utils import batch_space

from .._errors import ShapeError
from .._pytree import single
from ._residual import ResidualEnvironment, check_action, reset, step, step_or_reset

_reset, _step = jax.jit(reset), jax.jit(step)
_reset_all = jax.jit(jax.vmap(reset, (None, 0)))
_step_all = jax.jit(jax.vmap(step_or_reset, (None, 0, 0)))


class ResidualEnv(gymnasium.Env):
    """One environment."""

    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(self, environment: ResidualEnvironment):
        self._environment, self._state = single(environment), None
        self.observation_space, self.action_space = _spaces(environment)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed)
        self._state, seen = _reset(self._environment, jax.random.key(_draw(self.np_random)))
        return np.asarray(seen), {}

    def step(self, action):
        if self._state is None:
            raise gymnasium.error.ResetNeeded("reset() comes before step().")
        check_action("action", action, self.action_space.shape)
        found = _step(self._environment, self._state, np.asarray(action, np.float32))
        self._state = found.state
        info = {name: np.asarray(value) for name, value in found.told._asdict().items()}
        ends = bool(found.terminated), bool(found.truncated)
        return np.asarray(found.observation), float(found.reward), *ends, info


class ResidualVectorEnv(gymnasium.vector.VectorEnv):
    """Many at once, in one compiled call; after its last step, an environment begins anew with the next.

    With a list of seeds each begins as a `ResidualEnv` with its seed does, with one seed as with that, the next, and so
    on, as gymnasium's own have it.
    """

    metadata = {"render_modes": [], "autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(self, environment: ResidualEnvironment, count: int):
        self._environment, self._state, self.num_envs = single(environment), None, count
        self.single_observation_space, self.single_action_space = _spaces(environment)
        self.observation_space = batch_space(self.single_observation_space, count)
        self.action_space = batch_space(self.single_action_space, count)

    def reset(self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None):
        if isinstance(seed, list):
            seeds = seed
        else:
            super().reset(seed=seed)
            seeds = [None if seed is None else seed + i for i in range(self.num_envs)]
        if len(seeds) != self.num_envs:
            raise ShapeError(f"seed is a list of {len(seeds)}, expected one for each of {self.num_envs} environments.")
        drawn = [_draw(self.np_random if own is None else seeding.np_random(own)[0]) for own in seeds]
        self._state, seen = _reset_all(self._environment, jax.vmap(jax.random.key)(np.array(drawn)))
        return np.asarray(seen), {}

    def step(self, actions):
        if self._state is None:
            raise gymnasium.error.ResetNeeded("reset() comes before step().")
        check_action("actions", actions, self.action_space.shape)
        before = np.asarray(self._state.over)
        found = _step_all(self._environment, self._state, np.asarray(actions, np.float32))
        self._state = found.state
        info = {name: np.asarray(value) for name, value in found.told._asdict().items()}
        info |= {f"_{name}": ~before for name in tuple(info)}  # of which environments it is told
        ends = np.asarray(found.terminated), np.asarray(found.truncated)
        return np.asarray(found.observation), np.asarray(found.reward, np.float64), *ends, info


def _draw(generator: np.random.Generator) -> int:
    return int(generator.integers(2**31))


def _spaces(environment: ResidualEnvironment) -> tuple[gymnasium.Space, gymnasium.Space]:
    most = np.full(environment.size, np.inf, np.float32)
    ones = np.ones(environment.joints, np.float32)
    return gymnasium.spaces.Box(-most, most), gymnasium.spaces.Box(-ones, ones)
