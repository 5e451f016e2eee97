# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#       format_version: '1.3'
#       jupytext_version: 1.19.6
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Many starts at once
#
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/)
# (upload it there, into a clone of jaxrmp)
#
# A policy is a function, so a thousand of it is `vmap`. Here one policy of the Panda is asked at many states, rolled out
# from many starts, judged end by end as `jaxrmp evaluate` does with learned skills, and run in physics by MJX, policy and
# contacts in one compiled program. About a minute on two cores, most of it compiling MJX.

# %% tags=["skip-execution"]
# %pip install --quiet "..[simulation,learning,plots]"  # the clone of jaxrmp that this notebook lies in

# %%
import tempfile
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxrmp
from jaxrmp import evaluation, leaves, scenes
from jaxrmp.kinematics import ControlPoints, panda
from jaxrmp.simulation import KinematicEngine, MjxEngine, Problem, StopCriteria
from jaxrmp.visualization import figure_style

# Compiled programs are kept between runs; the library itself never switches this on.
jax.config.update("jax_compilation_cache_dir", str(Path(tempfile.gettempdir()) / "jaxrmp_notebooks"))
plt.rcParams.update(figure_style())

# %% [markdown]
# ## The policy
#
# The hand is drawn to a point; joints keep off their limits and are damped.

# %%
robot = panda()
hand = ControlPoints(robot, "panda_hand_tcp")
goal = np.array([0.45, 0.2, 0.5], np.float32)
to_goal = jaxrmp.compose(hand, jaxrmp.Pointwise(jaxrmp.Translation(goal)))
limits = leaves.JointLimit(robot.lower, robot.upper)
pull = leaves.Attractor(
    np.zeros(3, np.float32), weight_near=5.0, weight_far=5.0, gain=3.0, sharpness=6.0, damping_rate=6.0
)
tree = jaxrmp.pullback(to_goal, jaxrmp.Batched(pull, shared=True)) + limits + leaves.Damping(0.05, 4.0)

# %% [markdown]
# ## Many states
#
# Not the policy's code but a transformation makes it a batch. The tree is an argument, so `in_axes` decides what is
# many: states, or goals, or both. (On a CPU, `jax.lax.map(..., batch_size=1024)` takes half the time of one `vmap` from some
# ten thousand states on: what lies between the operations stays in the caches.)

# %%
problem = Problem(tree, to_goal, hand, robot.lower, robot.upper)
starts = evaluation.sample_starts(problem, 1024, seed=0, margin=0.3)
Q, QD = jnp.asarray(starts), jnp.zeros_like(starts)
many = jax.jit(jax.vmap(jaxrmp.acceleration, in_axes=(None, 0, 0)))
many(tree, Q, QD).block_until_ready()
began = time.perf_counter()
for _ in range(20):
    many(tree, Q, QD).block_until_ready()
print(f"{(time.perf_counter() - began) / 20 / len(Q) * 1e9:.0f} ns for one of {len(Q)} accelerations")

# %% [markdown]
# ## Many rollouts, judged
#
# An engine moves the joints until each rollout is over: converged, at rest elsewhere, diverged, or out of time. Whoever
# ends makes room for the next start. The certificate is evaluated on the way.

# %%
criteria = StopCriteria(tolerance=0.01, duration=8.0)
kinematic = evaluation.evaluate(KinematicEngine(problem, criteria, dt=0.005), problem, limits, starts[:128], batch=32)
kinds = {kind.name.lower(): int((kinematic.ends.kind == kind).sum()) for kind in evaluation.KINDS}
print(
    kinds, f"median {np.median(kinematic.seconds):.1f} s, energy rises by at most {kinematic.energy_increase.max():.1e}"
)

figure, axes = plt.subplots()
axes.hist(kinematic.seconds, bins=30)
axes.set(xlabel="time until the rollout was over (s)", ylabel="starts")
plt.show()

# %% [markdown]
# ## The same in physics
#
# MJX is MuJoCo in JAX. The engine asks the policy at every millisecond, turns its acceleration into torques within the
# arm's limits, and steps the physics, contacts included, for the whole batch in one program. (A few starts and half a
# second only: this is a CPU, and a notebook of a minute.)

# %%
few, soon = starts[:32], StopCriteria(tolerance=0.01, duration=0.5)
began = time.perf_counter()
physics = MjxEngine(scenes.arm_alone(), problem, soon)
state = physics.begin(few)
state = physics.advance(state)
compiled = time.perf_counter() - began
began = time.perf_counter()
state = physics.advance(state)
print(
    f"compiled in {compiled:.0f} s; then {len(few) * physics.chunk / (time.perf_counter() - began):.0f} steps a second"
)

# %% [markdown]
# Against the kinematic rollouts, which do exactly what the policy asks: where nothing touches and no torque saturates,
# the two agree.

# %%
reference = KinematicEngine(problem, soon, dt=0.001)
ideal = reference.begin(few)
while ideal.track.steps.max() < 2 * physics.chunk:
    ideal = reference.advance(ideal)
untouched = np.asarray(state.track.touched) == 0
difference = np.abs(np.asarray(state.q) - np.asarray(ideal.q)).max(axis=1)
print(
    f"{untouched.sum()} of {len(few)} touched nothing; there the joints differ by {difference[untouched].max():.1e} rad"
)

# %%
assert jaxrmp.uncertified_leaves(tree) == ()
assert kinds["diverged"] == 0 and kinds["converged"] > 0.7 * 128
assert kinematic.energy_increase.max() < 1e-3 and kinematic.residual.max() < 1e-2
assert untouched.sum() >= 16 and np.median(difference[untouched]) < 0.01
