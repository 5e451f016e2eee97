"""A learned diffeomorphism as a task map: curved paths on this side of it are straight lines on the other."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

from .._linalg import matmul
from .._pytree import pytree, single
from .._task_map import Pushforward, TaskMap

_STRETCH = 1.5  # largest logarithm by which a coupling stretches a coordinate


@pytree
class Couplings:
    """The parameters of L affine couplings of R^m, stacked: `rotation` [L, m, m], applied before each; and the network
    from the first a coordinates to stretch and shift of the others: `weights_1` [L, h, a], `biases_1` [L, h],
    `weights_2` [L, h, h], `biases_2` [L, h], `weights_3` [L, 2 (m - a), h], `biases_3`."""

    rotation: jax.Array
    weights_1: jax.Array
    biases_1: jax.Array
    weights_2: jax.Array
    biases_2: jax.Array
    weights_3: jax.Array
    biases_3: jax.Array


@pytree
class Flow(TaskMap):
    """A diffeomorphism `y = phi(x)` of R^m that keeps the origin, made of affine couplings.

    Each coupling turns its input by a fixed rotation, keeps the first half z_a of it and moves the other,
    `z_b exp(s(z_a)) + t(z_a)`, with s, at most 1.5, and t from a network of two layers of tanh. Its inverse is as exact
    and as fast. Behind it, an attractor is a policy with one place of rest, the origin, whatever the networks are.

    **Arguments**: `couplings`, whose parameters carry a leading axis of L; `back` [m, m], the rotation after the last;
    `length`, units of x, that is one inside; `origin` [m], where zero goes inside. Made by `initial_flow`.

    Dinh et al. 2017, section 3.4; Rana et al., Euclideanizing Flows (2020), section 4.
    """

    couplings: Couplings
    back: jax.Array
    length: jax.Array
    origin: jax.Array

    def __call__(self, x):
        flow = _as(self, x.dtype)

        def coupling(z, layer):
            z = matmul(layer.rotation, z)
            za, zb, s, t = _halves(layer, z)
            return jnp.concatenate([za, zb * jnp.exp(s) + t]), None

        z, _ = jax.lax.scan(coupling, x / flow.length, flow.couplings)
        return (matmul(flow.back, z) - flow.origin) * flow.length

    def inverse(self, y: jax.Array) -> jax.Array:
        """The point x [m] that goes to `y` [m]."""
        flow = _as(self, y.dtype)

        def coupling(z, layer):
            za, zb, s, t = _halves(layer, z)
            return matmul(jnp.concatenate([za, (zb - t) * jnp.exp(-s)]), layer.rotation), None

        z = matmul(y / flow.length + flow.origin, flow.back)
        return jax.lax.scan(coupling, z, flow.couplings, reverse=True)[0] * flow.length

    def pushforward(self, x, xd):
        flow = _as(self, x.dtype)

        def coupling(carried, layer):
            # Point, velocity, second derivative along the motion, and Jacobian; a network's in the same pass.
            z, v, c, J = (matmul(layer.rotation, part) for part in carried)
            a = layer.weights_1.shape[-1]
            h, dh, ddh, slope = _tanh_layer(layer.weights_1, layer.biases_1, z[:a], v[:a], c[:a], None)
            h, dh, ddh, slope = _tanh_layer(layer.weights_2, layer.biases_2, h, dh, ddh, slope)
            raw, d_raw, dd_raw, slope = (matmul(layer.weights_3, part) for part in (h, dh, ddh, slope))
            raw, k = raw + layer.biases_3, z.shape[0] - a
            tanh = jnp.tanh(raw[:k] / _STRETCH)
            rate = 1 - tanh * tanh
            ds = rate * d_raw[:k]
            dds = rate * dd_raw[:k] - 2 / _STRETCH * tanh * ds * d_raw[:k]
            e = jnp.exp(_STRETCH * tanh)
            ez = e * z[a:]
            below = matmul((ez * rate)[:, None] * slope[:k] + slope[k:], J[:a]) + e[:, None] * J[a:]
            z = jnp.concatenate([z[:a], ez + raw[k:]])
            c = jnp.concatenate([c[:a], e * (c[a:] + 2 * v[a:] * ds) + ez * (dds + ds * ds) + dd_raw[k:]])
            v = jnp.concatenate([v[:a], e * v[a:] + ez * ds + d_raw[k:]])
            return (z, v, c, jnp.concatenate([J[:a], below])), None

        eye = jnp.eye(x.shape[0], dtype=x.dtype)
        start = (x / flow.length, xd / flow.length, jnp.zeros_like(x), eye)
        (z, v, c, J), _ = jax.lax.scan(coupling, start, flow.couplings)
        z, v, c, J = (matmul(flow.back, part) for part in (z, v, c, J))
        return Pushforward((z - flow.origin) * flow.length, v * flow.length, J, c * flow.length)

    def centred(self) -> "Flow":
        """The same couplings, with the origin where it belongs."""
        zero = replace(self, origin=jnp.zeros_like(self.origin))
        return replace(self, origin=zero(jnp.zeros_like(self.origin)) / self.length)


def initial_flow(seed: int, dimension: int, couplings: int = 12, hidden: int = 32, length: float = 1.0) -> Flow:
    """The identity of R^m as a `Flow` that is ready to be trained.

    **Arguments**: `seed`, of rotations and first weights; `dimension` m, 2 or more; `couplings` L; `hidden`, the width
    of the networks' layers; `length`, see `Flow`.
    """
    rng, m, a = np.random.default_rng(seed), dimension, (dimension + 1) // 2
    rotations, total = [], np.eye(m)
    for _ in range(couplings):
        Q, R = np.linalg.qr(rng.normal(size=(m, m)))
        rotations.append(Q * np.sign(np.diag(R)))
        total = rotations[-1] @ total
    L, h, out = couplings, hidden, 2 * (m - a)
    layers = Couplings(
        rotation=np.stack(rotations),
        weights_1=rng.normal(size=(L, h, a)) * 2 / np.sqrt(a),
        biases_1=rng.uniform(-1.5, 1.5, (L, h)),
        weights_2=rng.normal(size=(L, h, h)) / np.sqrt(h),
        biases_2=np.zeros((L, h)),
        weights_3=np.zeros((L, out, h)),
        biases_3=np.zeros((L, out)),
    )
    flow = Flow(layers, total.T, np.asarray(length), np.zeros(m))
    return jax.tree.map(jnp.asarray, single(flow))


def _as(flow: Flow, dtype) -> Flow:
    return jax.tree.map(lambda value: jnp.asarray(value, dtype), flow)


def _halves(layer: Couplings, z):
    """What a coupling keeps, what it moves, and by how much: the logarithm of its stretch, and its shift."""
    za, zb = z[: layer.weights_1.shape[-1]], z[layer.weights_1.shape[-1] :]
    h = jnp.tanh(matmul(layer.weights_1, za) + layer.biases_1)
    h = jnp.tanh(matmul(layer.weights_2, h) + layer.biases_2)
    raw = matmul(layer.weights_3, h) + layer.biases_3
    return za, zb, _STRETCH * jnp.tanh(raw[: len(zb)] / _STRETCH), raw[len(zb) :]


def _tanh_layer(weights, biases, x, dx, ddx, slope):
    """`tanh(weights x + biases)`, its first and second derivative along a motion, and its slope by the first input."""
    h = jnp.tanh(matmul(weights, x) + biases)
    rate, along = 1 - h * h, matmul(weights, dx)
    dh = rate * along
    ddh = rate * matmul(weights, ddx) - 2 * h * dh * along
    return h, dh, ddh, rate[:, None] * (weights if slope is None else matmul(weights, slope))
