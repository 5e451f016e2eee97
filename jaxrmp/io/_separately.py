"""The coordinates of a map, each as a space of its own."""

from collections.abc import Callable

import jax.numpy as jnp

from .._pytree import pytree
from .._task_map import Pushforward, TaskMap, pushforward


@pytree
class Separately(TaskMap):
    """The coordinates [P] of a map of one vector as P points [P, 1].

    A leaf that treats them one by one then has P metrics of one number, in place of a diagonal matrix [P, P] that for
    the pairs of a sphere-covered robot and a point cloud would not fit into memory.
    """

    task_map: Callable

    def __call__(self, x):
        return self.task_map(x)[:, None]

    def pushforward(self, x, xd):
        return Pushforward(*(jnp.expand_dims(part, 1) for part in pushforward(self.task_map, x, xd)))
