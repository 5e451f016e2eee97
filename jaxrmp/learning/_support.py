"""Where a learned metric has something to say: near the demonstrations it was trained on."""

import jax
import jax.numpy as jnp
import numpy as np

from .._pytree import pytree


@pytree
class Support:
    """A weight that is nearly 1 along a path and falls to 0 away from it: `w = 1 - exp(-strength sum_p k_p)`.

    `k_p = exp(-|x - anchor_p|^2 / (2 reach^2))`. With the strength of `support_of_path`, w is 0.95 on the path, 0.5 at
    about 1.7 `reach` from it, and 0.03 at three times that reach. Smooth everywhere.

    **Arguments**: `anchors` [P, m], points of the path, m; `reach`, m; `strength`.
    """

    anchors: jax.Array
    reach: jax.Array | float
    strength: jax.Array | float

    def __call__(self, x: jax.Array) -> jax.Array:
        """The weight at x [m], a scalar."""
        offset = x - jnp.asarray(self.anchors, x.dtype)
        near = jnp.exp(-jnp.sum(offset * offset, axis=-1) / (2 * self.reach**2))
        return (1 - jnp.exp(-self.strength * jnp.sum(near))).astype(x.dtype)


def support_of_path(path: np.ndarray, reach: float, anchors: int = 24) -> Support:
    """The support of a path [T, m], m, from `anchors` of its points."""
    path = np.asarray(path, float)
    points = path[np.linspace(0, len(path) - 1, anchors).round().astype(int)]
    square = np.sum((points[:, None] - points) ** 2, axis=-1)
    strength = 3.0 / np.median(np.exp(-square / (2 * reach**2)).sum(1))
    return Support(*(jnp.asarray(value, jnp.float32) for value in (points, reach, strength)))
