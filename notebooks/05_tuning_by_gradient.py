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
# # Tuning by gradient
#
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/)
# (upload it there, into a clone of jaxrmp)
#
# A tree of policies has many gains, and they are usually turned by hand. Here a loss on whole motions is differentiated
# through `jaxrmp.simulation.rollout`, and [optax](https://optax.readthedocs.io) turns them: a planar arm of three links
# is to bring its hand to a goal behind a disc, soon and without touching. About half a minute on two cores.

# %% tags=["skip-execution"]
# %pip install --quiet "..[learning,plots]"  # the clone of jaxrmp that this notebook lies in

# %%
import tempfile
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import optax

from jaxrmp import Distance, pullback
from jaxrmp.inspection import inspect, table
from jaxrmp.leaves import Attractor, CollisionAvoidance, Damping
from jaxrmp.simulation import rollout
from jaxrmp.visualization import figure_style

# Compiled programs are kept between runs; the library itself never switches this on.
jax.config.update("jax_compilation_cache_dir", str(Path(tempfile.gettempdir()) / "jaxrmp_notebooks"))
plt.rcParams.update(figure_style())

GOAL, CENTER, RADIUS = np.array([1.2, 1.3]), np.array([1.9, 0.3]), 0.3
DT, DURATION = 0.01, 6.0


# %% [markdown]
# ## The policy, as a function of its gains
#
# Three leaves: the hand is drawn to the goal, the ends of the last two links keep off the disc, and every joint is
# damped. Six gains, all positive, so what is tuned is their logarithms. The start is a plausible guess by hand.


# %%
def joints_of_arm(q):  # ends of the three links, each 0.8 m long: [3, 2]
    angles = jnp.cumsum(q)
    return jnp.cumsum(0.8 * jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=1), axis=0)


def hand(q):
    return joints_of_arm(q)[2]


def distances(q):  # of the ends of the last two links to the disc: [2]
    return jnp.concatenate([Distance(CENTER, RADIUS)(p) for p in (joints_of_arm(q)[1], joints_of_arm(q)[2])])


def policy(logs):
    g = {name: jnp.exp(value) for name, value in logs.items()}
    return (
        pullback(hand, Attractor(GOAL, gain=g["pull"], damping_rate=g["pull damping"], sharpness=4.0))
        + pullback(distances, CollisionAvoidance(barrier=g["barrier"], damping_rate=g["disc damping"], reach=0.4))
        + Damping(g["joint weight"], g["joint damping"])
    )


by_hand = {
    "pull": 1.0,
    "pull damping": 2.0,
    "barrier": 0.01,
    "disc damping": 1.0,
    "joint weight": 0.1,
    "joint damping": 2.0,
}
by_hand = {name: jnp.float32(np.log(value)) for name, value in by_hand.items()}

# %% [markdown]
# ## The loss
#
# Over eight starts: the mean distance of the hand to the goal over six seconds, which rewards arriving soon and staying;
# a penalty on clearance below 3 cm; and a little of the joint accelerations, or the gains would grow without end.

# %%
rng = np.random.default_rng(0)
starts = jnp.asarray(np.array([-0.6, 0.4, 0.3]) + rng.uniform(-0.15, 0.15, (16, 3)), jnp.float32)
training, held_out = starts[:8], starts[8:]


def motion(logs, starts):
    return jax.vmap(lambda q: rollout(policy(logs), q, duration=DURATION, dt=DT))(starts)


def loss_of(logs, starts):
    path = motion(logs, starts)
    away = jax.vmap(jax.vmap(hand))(path.q) - GOAL
    arriving = jnp.sqrt((away**2).sum(-1) + 1e-6).mean()
    clearance = jax.vmap(jax.vmap(distances))(path.q)
    touching = (jnp.maximum(0.03 - clearance, 0) ** 2).mean()
    effort = (jnp.diff(path.qd, axis=1) ** 2).mean() / DT**2
    return arriving + 1e4 * touching + 1e-2 * effort


# %% [markdown]
# ## Tuning
#
# `jax.value_and_grad` goes through 600 steps of eight rollouts, whose intermediate values are computed again on the way
# back rather than kept. The whole update is compiled once. Near the disc, motions are sensitive and gradients of late
# states can be large, hence the clipping; and step sizes that fade out let the gains settle.

# %%
UPDATES = 50
optimiser = optax.chain(optax.clip_by_global_norm(1.0), optax.adam(optax.cosine_decay_schedule(0.1, UPDATES)))


@jax.jit
def update(logs, state):
    value, slope = jax.value_and_grad(loss_of)(logs, training)
    change, state = optimiser.update(slope, state)
    return optax.apply_updates(logs, change), state, value


tuned, state, losses = by_hand, optimiser.init(by_hand), []
for _ in range(UPDATES):
    tuned, state, value = update(tuned, state)
    losses.append(float(value))

for name in by_hand:
    print(f"{name:14s} {float(jnp.exp(by_hand[name])):8.3f} -> {float(jnp.exp(tuned[name])):8.3f}")

# %% [markdown]
# ## Before and after
#
# On starts that were not tuned for.

# %%
evaluate = jax.jit(lambda logs, starts: (loss_of(logs, starts), motion(logs, starts)))
(before, slow), (after, fast) = evaluate(by_hand, held_out), evaluate(tuned, held_out)
clearance = float(jax.vmap(jax.vmap(distances))(fast.q).min())

figure, panels = plt.subplots(1, 3)
panels[0].semilogy(losses)
panels[0].set(xlabel="update", ylabel="loss", title="loss, tuned starts")
for path, color, label in ((slow, "C0", "by hand"), (fast, "C1", "tuned")):
    hands = np.asarray(jax.vmap(jax.vmap(hand))(path.q))
    panels[1].plot(*hands[0].T, color=color, label=label)
    panels[1].plot(*hands[1:].T, color=color)
    panels[2].plot(path.time[0], np.linalg.norm(hands - GOAL, axis=-1).T, color=color)
panels[1].add_patch(plt.Circle(CENTER, RADIUS, color="0.7"))
panels[1].plot(*GOAL, "k*", ms=12)
figure.legend(loc="outside lower center", ncols=2)
panels[1].set(xlabel="x (m)", ylabel="y (m)", aspect="equal", title="hand, held-out starts")
panels[2].set(xlabel="time (s)", ylabel="distance (m)", title="distance to the goal")
plt.show()
print(f"loss on held-out starts {before:.3f} -> {after:.3f}; least clearance {clearance:.3f} m")

# %% [markdown]
# Which leaf does what, half a second into the first motion?

# %%
print(table(jax.jit(lambda logs, q, qd: inspect(policy(logs), q, qd))(tuned, fast.q[0, 25], fast.qd[0, 25])))

assert losses[-1] < 0.5 * losses[0] and after < 0.5 * before
assert clearance > 0
