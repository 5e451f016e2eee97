# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # RMPflow from scratch
#
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/)
# (upload it there, into a clone of jaxrmp)
#
# RMPflow (Cheng et al., 2018) takes few lines of plain `jax.numpy`: here it moves a planar arm of three links to a goal,
# round a disc. At the end jaxrmp computes the same policy, and the two must agree to rounding.

# %% tags=["skip-execution"]
# %pip install --quiet "..[plots]"  # the clone of jaxrmp that this notebook lies in

# %%
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxrmp
from jaxrmp.visualization import figure_style

plt.rcParams.update(figure_style())
jax.config.update("jax_enable_x64", True)  # double precision, so that agreement can be told from luck

GOAL, CENTER, RADIUS = jnp.array([1.2, 1.3]), jnp.array([1.9, 0.3]), 0.3

# %% [markdown]
# ## The algebra
#
# A policy is a pair $[f, M]$: a force, and a metric that says how much it matters in which direction. Policies on the
# same space add. A policy on $y = \psi(x)$ is seen from $x$ by **pullback**,
# $f_x = J^\top (f_y - M_y \dot J \dot x)$ and $M_x = J^\top M_y J$. At the root, the acceleration is $M^+ f$.


# %%
def pullback(psi, leaf, x, xd):
    velocity = lambda x: jax.jvp(psi, (x,), (xd,))  # noqa: E731
    (y, yd), (_, Jdot_xd) = jax.jvp(velocity, (x,), (xd,))
    J = jax.jacobian(psi)(x)
    f, M = leaf(y, yd)
    return J.T @ (f - M @ Jdot_xd), J.T @ M @ J


def resolve(f, M):
    return jnp.linalg.pinv(M) @ f


# %% [markdown]
# ## A leaf with a certificate
#
# A geometric dynamical system is a metric $G(x, \dot x)$, a potential $\Phi(x)$ and a damping $B(x, \dot x)$:
# $f = -\nabla\Phi - B\dot x - \xi$ and $M = G + \Xi$. The curvature terms
# $\Xi = \frac12 \sum_i \dot x_i\, \partial g_i / \partial \dot x$ and
# $\xi = \dot G \dot x - \frac12 \nabla_x (\dot x^\top G \dot x)$ make
# $V = \frac12 \dot x^\top G \dot x + \Phi$ fall at the rate $\dot x^\top B \dot x$, and autodiff writes them for us.


# %%
def gds(metric, potential, damping):
    def leaf(x, xd):
        momentum = lambda x, v: metric(x, v) @ xd  # noqa: E731
        Xi = 0.5 * jax.jacobian(momentum, argnums=1)(x, xd)
        Gdot_xd = jax.jvp(lambda x: momentum(x, xd), (x,), (xd,))[1]
        xi = Gdot_xd - 0.5 * jax.grad(lambda x: xd @ metric(x, xd) @ xd)(x)
        return -jax.grad(potential)(x) - damping(x, xd) @ xd - xi, metric(x, xd) + Xi

    return leaf


# %% [markdown]
# ## Three spaces, three leaves
#
# The hand is drawn to the goal; the distance of each link's end to the disc has a metric that grows as it closes in, but
# only while it closes in (it depends on velocity); every joint is damped a little. Links' ends are all that the disc
# repels here: a link's middle is free to cut through it. And the policy is local: from other starts, or round larger
# discs, it can come to rest before the goal, where the forces balance. Stable does not mean that it plans.


# %%
def joints_of_arm(q):  # ends of the three links, each 0.8 m long: [3, 2]
    angles = jnp.cumsum(q)
    return jnp.cumsum(0.8 * jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=1), axis=0)


def to_goal(q):
    return joints_of_arm(q)[2] - GOAL


def to_disc(k):
    return lambda q: jnp.linalg.norm(joints_of_arm(q)[k] - CENTER)[None] - RADIUS


attractor = (
    lambda x, xd: jnp.eye(2),
    lambda x: jnp.logaddexp(10 * jnp.sqrt(x @ x + 1e-4), -10 * jnp.sqrt(x @ x + 1e-4)) / 10,
    lambda x, xd: 2.0 * jnp.eye(2),
)
near = lambda d: (jnp.maximum(0.4 - d, 0) / d) ** 2  # noqa: E731
obstacle = (
    lambda d, dd: (near(d) * (0.01 + jnp.minimum(dd, 0) * dd))[:, None],
    lambda d: 0.02 * near(d)[0] ** 2,
    lambda d, dd: (near(d) * (0.01 + jnp.minimum(dd, 0) * dd))[:, None],
)
damper = (lambda q, qd: 0.01 * jnp.eye(3), lambda q: 0.0 * q[0], lambda q, qd: 0.05 * jnp.eye(3))

SPACES = [(to_goal, attractor), (to_disc(1), obstacle), (to_disc(2), obstacle), (lambda q: q, damper)]


def policy(q, qd):
    forms = [pullback(psi, gds(*leaf), q, qd) for psi, leaf in SPACES]
    return resolve(sum(f for f, _ in forms), sum(M for _, M in forms))


def energy(q, qd):
    V = 0.0
    for psi, (metric, potential, _) in SPACES:
        x, xd = jax.jvp(psi, (q,), (qd,))
        V += 0.5 * xd @ metric(x, xd) @ xd + potential(x)
    return V


# %%
def step(state, _):
    q, qd = state
    qd = qd + 0.005 * policy(q, qd)
    return (q + 0.005 * qd, qd), (q, energy(q, qd))


start = jnp.array([-0.6, 0.4, 0.3])
_, (q, V) = jax.jit(lambda q: jax.lax.scan(step, (q, jnp.zeros(3)), length=3000))(start)
hand = np.asarray(jax.vmap(joints_of_arm)(q))[:, 2]
clearance = np.asarray(jax.vmap(lambda q: jnp.concatenate([to_disc(1)(q), to_disc(2)(q)]))(q)).min()

figure, (left, right) = plt.subplots(1, 2)
for k in (0, 600, 1000, 1300, 2999):
    left.plot(*np.vstack([np.zeros(2), joints_of_arm(q[k])]).T, "o-", color="dimgrey", alpha=0.3 + 0.6 * k / 2999)
left.plot(*hand.T, "C0")
left.add_patch(plt.Circle(CENTER, RADIUS, color="C1"))
left.plot(*GOAL, "k*", ms=13)
left.set(xlabel="x (m)", ylabel="y (m)", aspect="equal", title="the arm and the path of its hand")
right.plot(0.005 * np.arange(3000), V)
right.set(xlabel="time (s)", title="energy V")
plt.show()
print(f"hand ends {np.linalg.norm(hand[-1] - GOAL):.1e} m from the goal, clearance {clearance:.3f} m")

# %% [markdown]
# ## The same with jaxrmp
#
# Nodes add, `pullback` takes any differentiable function, and the energy comes along.

# %%
tree = sum(
    (jaxrmp.pullback(psi, jaxrmp.GeometricDynamicalSystem.of(*leaf)) for psi, leaf in SPACES[1:]),
    start=jaxrmp.pullback(to_goal, jaxrmp.GeometricDynamicalSystem.of(*attractor)),
)
rng = np.random.default_rng(0)
states = jnp.asarray(np.asarray(q)[rng.integers(0, 3000, 200)])
speeds = jnp.asarray(rng.normal(0, 0.5, (200, 3)))
ours = jax.vmap(policy)(states, speeds)
theirs = jax.vmap(lambda q, qd: jaxrmp.acceleration(tree, q, qd))(states, speeds)
difference = float((jnp.abs(ours - theirs) / (1 + jnp.abs(ours))).max())
residual = float(jax.vmap(lambda q, qd: jaxrmp.certificate(tree, q, qd))(states, speeds).residual.max())
print(f"largest relative difference of accelerations {difference:.1e}; of the certificate {residual:.1e}")

assert difference < 1e-9 and residual < 1e-9
assert np.linalg.norm(hand[-1] - GOAL) < 5e-3 and clearance > 0 and np.diff(V).max() < 1e-3
