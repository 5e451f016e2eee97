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
# # A residual
#
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/)
# (upload it there, into a clone of jaxrmp)
#
# A policy is local: before a ball that is straight in its way, a hand may come to rest. Here a small network learns to
# add to the policy's accelerations what gets it past, by nothing but rollouts: `jaxrmp.environments` has the policy as
# controller and residual accelerations as actions, as pure functions that `jax.vmap` maps over thousands of episodes.
# For other people's learners, `environments.gymnasium_env` and `gymnasium_vector_env` are the same (extra `gym`).
# Under a minute on two cores.

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
from jax.flatten_util import ravel_pytree

from jaxrmp import environments
from jaxrmp.kinematics import forward_kinematics, load_robot_from_string
from jaxrmp.policies import reaching_policy
from jaxrmp.visualization import figure_style
from jaxrmp.world import RobotSpheres, Spheres, World

# Compiled programs are kept between runs; the library itself never switches this on.
jax.config.update("jax_compilation_cache_dir", str(Path(tempfile.gettempdir()) / "jaxrmp_notebooks"))
plt.rcParams.update(figure_style())

# %% [markdown]
# ## An arm that is stopped
#
# A planar arm of three links, a policy that takes its tip to a point, and a ball on the way. In an episode of 3 s, a
# step of the environment is 30 ms, in which the policy is called ten times. The residual may add up to 20 rad/s^2 to each
# joint; what comes of both is cut at 60.

# %%
ARM = """
<mujoco model="planar">
  <compiler angle="radian" autolimits="true"/>
  <default><joint axis="0 0 1" range="-2.6 2.6"/><geom type="capsule" size="0.03"/></default>
  <worldbody>
    <body name="upper"><joint name="shoulder"/><geom fromto="0 0 0 0.4 0 0"/>
      <body name="fore" pos="0.4 0 0"><joint name="elbow"/><geom fromto="0 0 0 0.3 0 0"/>
        <body name="hand" pos="0.3 0 0"><joint name="wrist"/><geom fromto="0 0 0 0.2 0 0"/>
          <site name="tip" pos="0.2 0 0"/></body></body></body>
  </worldbody>
</mujoco>"""
START, CENTER, RADIUS = np.array([-0.9, 0.9, 0.5], np.float32), np.array([0.62, 0.05, 0.0]), 0.1
robot = load_robot_from_string(ARM)
places = [("fore", 0.15), ("hand", 0.0), ("hand", 0.1), ("tip", 0.0)]  # frame, and how far along it, m
spheres = RobotSpheres([f for f, _ in places], np.array([[x, 0, 0] for _, x in places]), np.full(4, 0.04))
goal = np.eye(4, dtype=np.float32)
goal[:2, 3] = 0.5, 0.35
policy = reaching_policy(robot, "tip", START, spheres, self_collision=False)
environment = environments.ResidualEnvironment(
    policy,
    start=START,
    T_world_target=goal,
    world=World(spheres=Spheres.of([(CENTER, RADIUS)], capacity=1)),
    largest=np.full(3, 20.0),
    acceleration_limit=np.full(3, 60.0),
    spread=0.1,
    target_spread=np.array([0.03, 0.03, 0.0]),
    length=100,
    dt=0.03,
)

# %% [markdown]
# ## Episodes, as one function
#
# The residual is a small network of what the environment shows, whose last layer is zero at first: learning starts at the
# policy itself. Episodes all begin elsewhere, and none is begun anew.


# %%
def network(parameters, seen):
    hidden = jnp.tanh(parameters["in"] @ (SCALE * seen) + parameters["bias"])
    return jnp.tanh(parameters["out"] @ hidden + parameters["push"])


HIDDEN, n = 12, environment.joints
SCALE = jnp.concatenate([jnp.ones(n), 0.3 * jnp.ones(n), jnp.ones(n), 2 * jnp.ones(3), 5 * jnp.ones(1)])
zero = {
    "in": 0.5 * jax.random.normal(jax.random.key(7), (HIDDEN, environment.size)),
    "bias": jnp.zeros(HIDDEN),
    "out": jnp.zeros((n, HIDDEN)),
    "push": jnp.zeros(n),
}
flat, unravel = ravel_pytree(zero)


def episode(flat, key):
    """Every 30 ms of an episode: the tip, and what there is to tell; what comes after a touch counts as touched."""
    parameters = unravel(flat)
    state, seen = environments.reset(environment, key)

    def step(carried, _):
        state, seen, touched = carried
        found = environments.step(environment, state, network(parameters, seen))
        touched = touched | found.terminated
        tip = forward_kinematics(robot, found.state.motion.q, "tip")[:2, 3]
        return (found.state, found.observation, touched), (tip, found.told, touched)

    _, logged = jax.lax.scan(step, (state, seen, jnp.zeros((), bool)), length=environment.length)
    return logged


many = jax.jit(jax.vmap(episode, (0, 0)))
fresh = jax.random.split(jax.random.key(99), 64)  # held out: never learned on
before = many(jnp.tile(flat, (64, 1)), fresh)
left = np.asarray(before[1].distance[:, -1])
print(f"the policy alone: {(left < 0.03).sum()} of 64 arrive within 3 cm; {100 * left.mean():.0f} cm left in the mean")

# %% [markdown]
# ## Learning by trying
#
# Evolution strategies (Salimans et al. 2017): in each round, 32 random changes of the parameters and their opposites are
# tried on the same episodes, and the parameters go where those did better, by rank. No gradient goes through a rollout.
# What counts is to be near, soon; a touch costs more than never to arrive; and a little is asked for every action, so that
# the residual leaves the arm to the policy where it has nothing to add.

# %%
PAIRS, ROUNDS, SIGMA = 32, 60, 0.15


def gain(told, touched):
    wanted = told.distance + 0.01 * (told.action**2).sum(-1)
    return -wanted.mean(-1) - 0.5 * touched[..., -1]


@jax.jit
def learn(carried, key):
    flat, state = carried
    of_noise, of_episode = jax.random.split(key)
    noise = jax.random.normal(of_noise, (PAIRS, flat.size))
    keys = jnp.concatenate([jax.random.split(of_episode, PAIRS)] * 2)
    _, told, touched = jax.vmap(episode)(flat + SIGMA * jnp.concatenate([noise, -noise]), keys)
    gains = gain(told, touched)
    ranks = jnp.argsort(jnp.argsort(gains)) / (2 * PAIRS - 1) - 0.5
    slope = (ranks[:PAIRS] - ranks[PAIRS:]) @ noise / (PAIRS * SIGMA)
    step, state = optimizer.update(-slope, state)
    return (optax.apply_updates(flat, step), state), gains.mean()


optimizer = optax.adam(0.05)
carried, course = (flat, optimizer.init(flat)), []
for key in jax.random.split(jax.random.key(0), ROUNDS):
    carried, mean = learn(carried, key)
    course.append(float(mean))
learned = carried[0]

after = many(jnp.tile(learned, (64, 1)), fresh)
reached = np.asarray(after[1].distance[:, -1])
print(f"with the residual: {(reached < 0.03).sum()} of 64 arrive; {100 * reached.mean():.1f} cm left in the mean")

# %% [markdown]
# ## What it costs
#
# The policy's certificate says that its energy V falls. An action puts energy in, and the environment keeps count: along
# an episode V is at most what it was at first plus `put_in`. The certificate names what voids it, whatever the residual
# was trained to be. Try what keeps the certificate first: here a detour (`policies.find_detour`), a potential found by a
# look ahead, gets past too ([recipes](../docs/guides/recipes.md)). A residual is for what no potential does.

# %%
energy, put_in = (np.asarray(part) for part in (after[1].energy, after[1].put_in))
print(f"V at first {energy[:, 0].mean():.0f}, put in {put_in[:, -1].mean():.0f} in the mean of an episode")
state, seen = environments.reset(environment, fresh[0])
voided = jax.jit(environments.residual_certificate)(environment, state, network(unravel(learned), seen)).voided_by
print("the certificate is voided by", voided)

figure, axes = plt.subplots(1, 3)
for axis, (tips, *_), title in zip(axes, (before, after), ("the policy alone", "with the residual"), strict=False):
    axis.add_patch(plt.Circle(CENTER[:2], RADIUS, color="0.75"))
    axis.plot(*np.asarray(tips[:24]).transpose(2, 1, 0), color="C0", alpha=0.4)
    axis.plot(*goal[:2, 3], "k+")
    axis.set(title=title, xlabel="x (m)", ylabel="y (m)", aspect="equal")
axes[2].plot(course)
axes[2].set(title="learning", xlabel="round", ylabel="mean gain of a round")
plt.show()

# %%
assert (left < 0.03).mean() < 0.5  # most are stopped
assert (reached < 0.03).mean() > 0.9 and int(after[2][:, -1].sum()) == 0  # and get past, untouched
assert voided == ("residual",)
