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
# # Learning one subtask, step by step
#
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/)
# (upload it there, into a clone of jaxrmp)
#
# A skill of jaxrmp is a handful of *subtasks*: points on the hand, each with a policy of its own that was learned from
# demonstrations. This notebook learns a single one, the gripper's centre on its way round a cabinet door to the
# handle, and draws what every step does. It follows section 3 of Rana et al., *Learning Reactive Motion Policies in
# Multiple Task Spaces from Human Demonstrations* (CoRL 2019).
#
# The demonstrations come from jaxrmp's scripted demonstrator, so nothing is downloaded. They are synthetic: no person
# moved an arm. About half a minute on two cores.

# %% tags=["skip-execution"]
# %pip install --quiet "..[learning,plots]"  # the clone of jaxrmp that this notebook lies in

# %%
import tempfile
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxrmp
from jaxrmp import learning
from jaxrmp.leaves import Learned
from jaxrmp.simulation import rollout
from jaxrmp.synthetic import synthetic_demonstrations
from jaxrmp.visualization import figure_style

# Compiled programs are kept between runs; the library itself never switches this on.
jax.config.update("jax_compilation_cache_dir", str(Path(tempfile.gettempdir()) / "jaxrmp_notebooks"))
plt.rcParams.update(figure_style())

# %% [markdown]
# ## 1. Demonstrations: from joints to a point in the object's frame
#
# Six recordings of the seven joints at 30 Hz, each with the tracked pose of the handle. `prepare` drops the pauses,
# smooths, resamples evenly in arc length, runs forward kinematics, moves every point into the handle's frame and every
# end to the origin. What is left is geometry: positions and unit directions, `[subtask, demonstration, sample, 3]`.

# %%
robot = jaxrmp.kinematics.panda()
demonstrations = synthetic_demonstrations("door_reaching")
configuration = learning.Configuration(
    name="one_subtask",
    object="door_handle",
    subtasks=(learning.Subtask("gripper", "panda_link7", (0.0, 0.0, 0.207)),),
)
prepared = learning.prepare(configuration, robot, demonstrations)
positions, directions, velocities = (
    array[0] for array in (prepared.subtasks.positions, prepared.subtasks.directions, prepared.subtasks.velocities)
)
print(f"{len(demonstrations)} demonstrations of {[len(d.time) for d in demonstrations]} samples -> {positions.shape}")

# %% [markdown]
# ## 2. The nominal demonstration
#
# One demonstration will carry the potential: the one nearest to all others by dynamic time warping.

# %%
nominal, distances = learning.nominal_demonstration(list(positions))


def draw_demonstrations(axes):
    for k, path in enumerate(positions):
        style = {"color": "C1", "lw": 2, "zorder": 3} if k == nominal else {"color": "0.4", "lw": 1}
        axes.plot(path[:, 0], path[:, 1], **style)
    axes.plot(0, 0, "k*", ms=10, zorder=4)
    axes.set(xlabel="x (m)", aspect="equal")


figure, (left, right) = plt.subplots(1, 2)
draw_demonstrations(left)
left.set(ylabel="y (m)", title="from above; the nominal one thick")
right.grid(False)
image = right.imshow(distances / positions.shape[1] * 100)
right.set(title="DTW distance per sample (cm)", xlabel="demonstration", ylabel="demonstration")
figure.colorbar(image)
plt.show()

# %% [markdown]
# ## 3. The potential
#
# $$\Phi(x) = \sum_t w_t(x)\,\bigl(\phi_\perp(x - \zeta_t) + b_t\bigr)$$
#
# a valley along the nominal points $\zeta_t$, whose heights $b_t$ come from a convex program: $-\nabla\Phi$ shall point
# along the motion, and the heights shall not rise. The kernel width is chosen among several: best agreement with *all*
# demonstrations wins, provided that descent from 2,000 random starts ends at the goal, every time.

# %%
choice = learning.choose_potential(positions, directions, nominal, widths=(0.03, 0.04, 0.06, 0.08))
for trial in choice.trials:
    basin = "not needed" if trial.basin is None else f"{trial.basin.share_reached:.1%} of starts reach the goal"
    print(f"width {trial.width:.2f} m: mean cosine {trial.alignment:.3f}, {trial.beyond_90:.1%} beyond 90 deg; {basin}")
potential = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), choice.fit.potential)
print(
    f"chosen {choice.trial.width} m, solver {choice.fit.status}, Hessian at the goal {choice.fit.goal_hessian_eigenvalues}"
)

# %% [markdown]
# ## 4. The metric
#
# The gradient of one potential only knows one demonstration. A metric $M = LL^\top$, $L$ from a small network, turns
# and scales it: $-M^{-1}\nabla\Phi$ is fitted to the directions of all six by 1,000 updates of Adam. The speed
# that is asked for falls to zero within 3 cm of the goal.

# %%
x, v = learning.training_samples(prepared.subtasks, configuration.metric, seed=0)
slope = jax.vmap(jax.vmap(jax.grad(potential)))(jnp.asarray(x, jnp.float32)[None, 0])
fit = learning.train_metrics(
    jnp.asarray(x, jnp.float32), slope, jnp.asarray(v, jnp.float32), updates=1000, length_scale=0.1
)
factor = jax.tree.map(lambda a: a[0], fit.factors)

figure, axes = plt.subplots()
axes.semilogy(fit.losses)
axes.set(xlabel="update", ylabel="loss", title="training the metric")
plt.show()

# %% [markdown]
# Left, the gradient of the potential alone: everything joins the nominal path and takes it from there. Right, warped by
# the metric: near each demonstration the field runs along that demonstration. (Drawn in the horizontal plane through the
# goal; the paths start up to 20 cm above it and come down.)

# %%
leaf = Learned(potential, factor, speed=0.2, damping_rate=40.0)

low, high = positions.reshape(-1, 3).min(0)[:2] - 0.1, positions.reshape(-1, 3).max(0)[:2] + 0.1
grid_x, grid_y = np.meshgrid(np.linspace(low[0], high[0], 30), np.linspace(low[1], high[1], 30))
grid = jnp.asarray(np.stack([grid_x, grid_y, np.zeros_like(grid_x)], -1), jnp.float32)
over_grid = lambda function: np.asarray(jax.jit(jax.vmap(jax.vmap(function)))(grid))  # noqa: E731

figure, panels = plt.subplots(1, 2, sharey=True)
heights = over_grid(potential)
titles = {"potential alone": lambda x: -jax.grad(potential)(x), "warped by the metric": leaf.field}
for axes, (title, field) in zip(panels, titles.items(), strict=True):
    arrows = over_grid(field)
    axes.contourf(grid_x, grid_y, heights, levels=20, cmap="Blues", alpha=0.6)
    axes.streamplot(
        grid_x, grid_y, arrows[..., 0], arrows[..., 1], density=1.3, linewidth=0.6, arrowsize=0.7, color="C0"
    )
    draw_demonstrations(axes)
    axes.set(title=title)
panels[0].set(ylabel="y (m)")
plt.show()

# %% [markdown]
# ## 5. The policy
#
# As a leaf, the same potential and metric are a second-order system,
# $M\ddot x = -\kappa\nabla\Phi - \gamma M\dot x - \xi$, which follows that field the more closely the larger the damping
# rate $\gamma$. Here it moves a free point, from where each demonstration began; in a whole skill several such leaves
# pull on one arm.

# %%
starts = jnp.asarray(positions[:, 0], jnp.float32)
motion = jax.jit(jax.vmap(lambda x: rollout(leaf, x, duration=12.0)))(starts)
paths = np.asarray(motion.q)
errors = [learning.reproduction_errors(p[:, None], r[:, None]) for p, r in zip(positions, paths, strict=True)]
for k, error in enumerate(errors):
    print(f"demonstration {k}: " + ", ".join(f"{name} {value:.2f}" for name, value in error.items()))

figure, (left, right) = plt.subplots(1, 2)
draw_demonstrations(left)
left.plot(paths[..., 0].T, paths[..., 1].T, "C0--", lw=1.5, zorder=5)
left.set(ylabel="y (m)", title="demonstrated, and reproduced (dashed)")
right.plot(motion.time.T, motion.energy.T, "C0")
right.set(xlabel="time (s)", ylabel="energy V", title="energy of each rollout")
plt.show()

# %% [markdown]
# ## 6. The certificate
#
# $V = \frac12 \dot x^\top M \dot x + \kappa\Phi$ falls at exactly the rate $\dot x^\top B\dot x$: not because the network
# was trained to, but because of the form of the leaf. `certificate` differentiates V along the motion; what is left over
# is rounding.

# %%
with jax.enable_x64(True):
    exact = jax.tree.map(lambda a: jnp.asarray(a, jnp.float64), leaf)
    rng = np.random.default_rng(0)
    box = positions.reshape(-1, 3)
    states = jnp.asarray(rng.uniform(box.min(0) - 0.1, box.max(0) + 0.1, (200, 3)))
    speeds = jnp.asarray(rng.normal(0, 0.3, (200, 3)))
    certificates = jax.jit(jax.vmap(lambda x, xd: jaxrmp.certificate(exact, x, xd)))(states, speeds)
    residual = float(certificates.residual.max())
print(f"largest |dV/dt + dissipation| / (1 + |V|) over 200 random states: {residual:.1e}")

# %%
mean = {name: float(np.mean([error[name] for error in errors])) for name in errors[0]}
print("mean over the six:", {name: round(value, 2) for name, value in mean.items()})
assert choice.trial.basin.share_reached == 1.0
assert mean["dtw_cm"] < 2.5 and max(error["goal_cm"] for error in errors) < 0.2
assert residual < 1e-8
