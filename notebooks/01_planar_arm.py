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
# # A planar arm among obstacles
#
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/)
# (upload it there, into a clone of jaxrmp)
#
# A whole-arm policy from hand-designed leaves: a goal for the hand, obstacles of several kinds for the whole arm, limits
# of positions and velocities, a posture and damping. The world is a parameter: obstacles move, appear and vanish without
# compiling again. All leaves are certified, so the energy falls along every motion. About half a minute on two cores.

# %% tags=["skip-execution"]
# %pip install --quiet "..[robots,plots]"  # the clone of jaxrmp that this notebook lies in

# %%
import tempfile
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from jax.tree_util import Partial  # makes a plain function part of a pytree

import jaxrmp
from jaxrmp import inspection, pullback
from jaxrmp.kinematics import ControlPoints, load_robot_from_string
from jaxrmp.leaves import Attractor, CollisionAvoidance, Damping, JointLimit, JointVelocityLimit, Posture
from jaxrmp.simulation import rollout
from jaxrmp.visualization import figure_style
from jaxrmp.world import Boxes, Capsules, HalfSpaces, ObstacleDistances, Spheres, World

# Compiled programs are kept between runs; the library itself never switches this on.
jax.config.update("jax_compilation_cache_dir", str(Path(tempfile.gettempdir()) / "jaxrmp_notebooks"))
plt.rcParams.update(figure_style())

# %% [markdown]
# ## The arm
#
# Three links of 0.5 m in the plane z = 0, from a few lines of MJCF (a URDF or a file does as well), with four spheres a
# link for the distances.

# %%
LINK = 0.5
arm = load_robot_from_string("""
<mujoco model="planar">
  <default><joint axis="0 0 1" range="-2.6 2.6"/><geom type="capsule" size="0.03"/></default>
  <compiler angle="radian" autolimits="true"/>
  <worldbody>
    <body name="upper"><joint name="shoulder"/><geom fromto="0 0 0 0.5 0 0"/>
      <body name="fore" pos="0.5 0 0"><joint name="elbow"/><geom fromto="0 0 0 0.5 0 0"/>
        <body name="hand" pos="0.5 0 0"><joint name="wrist"/><geom fromto="0 0 0 0.5 0 0"/></body>
      </body>
    </body>
  </worldbody>
</mujoco>
""")
links = ("upper", "fore", "hand")
along = np.linspace(0.05, LINK, 4)
frames = tuple(link for link in links for _ in along)
spheres = ControlPoints(arm, frames, np.array([[x, 0.0, 0.0] for _ in links for x in along]))
tip = ControlPoints(arm, ("hand",), np.array([[LINK, 0.0, 0.0]]))


def tip_in_plane(q):
    return tip(q)[0, :2]


# %% [markdown]
# ## The world, and the policy
#
# Capacities are the numbers of slots; what is in them may change. The policy is a sum of leaves, each pulled back to the
# joints through the map to its own space.

# %%
turned = np.array([[0.8, -0.6, 0, 0.75], [0.6, 0.8, 0, 0.85], [0, 0, 1, 0], [0, 0, 0, 1.0]])
world = World(
    spheres=Spheres.of([([0.35, -0.75, 0.0], 0.15)], capacity=2),
    boxes=Boxes.of([(turned, [0.12, 0.06, 0.5])], capacity=1),
    capsules=Capsules.of([([-0.9, 0.5, 0.0], [-0.5, 0.9, 0.0], 0.05)], capacity=1),
    half_spaces=HalfSpaces.of([([0.0, 1.0, 0.0], -1.2)], capacity=1),
)
REST = np.array([-0.6, 0.9, 0.7])


def policy(goal, world):
    return (
        pullback(
            Partial(tip_in_plane),
            Attractor(goal, weight_near=5.0, weight_far=5.0, gain=3.0, sharpness=10.0, damping_rate=6.0),
        )
        + pullback(
            ObstacleDistances(spheres, world, 0.05),
            CollisionAvoidance(barrier=0.01, reach=0.1, frequency=50.0, damping_rate=2.0),
        )
        + JointLimit(arm.lower, arm.upper)
        + JointVelocityLimit(2.0)
        + Posture(REST, weight=0.02, stiffness=0.2)
        + Damping(weight=0.05)
    )


START = np.array([-1.2, 1.0, 0.6])
GOALS = np.array([[0.3, 1.1], [1.1, -0.7], [-0.2, 1.25], [1.05, 0.75]])

compiled = []


@jax.jit
def move(goal, world):
    compiled.append("move")  # Python runs this line when JAX traces the function, and then no more
    tree = policy(goal, world)
    path = rollout(tree, jnp.asarray(START, jnp.float32), duration=8.0, dt=0.002)
    clearance = jax.vmap(lambda q: ObstacleDistances(spheres, world, 0.05)(q).min())(path.q)
    return path, jax.vmap(tip_in_plane)(path.q), clearance


def numbers(tree):  # JAX arrays, so that every world is of the same types
    return jax.tree.map(jnp.asarray, tree)


runs = [move(jnp.asarray(goal), numbers(world)) for goal in GOALS]
for goal, (_, hand, clearance) in zip(GOALS, runs, strict=True):
    print(
        f"goal {goal}: left {np.linalg.norm(hand[-1] - goal) * 1e3:5.1f} mm, clearance {clearance.min() * 1e3:5.1f} mm"
    )

# %% [markdown]
# ## What it looks like
#
# Left: the arm on its way, every second, and the hand's paths. Right: the clearance of the whole arm.


# %%
def draw_world(axes, world):
    x, y = np.meshgrid(np.linspace(-1.6, 1.6, 120), np.linspace(-1.4, 1.6, 120))
    points = jnp.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    distance = np.asarray(jax.vmap(world.signed_distance)(points)).min(axis=1).reshape(x.shape)
    axes.contourf(x, y, distance, levels=[-10, 0], colors=["0.6"])
    axes.set_aspect("equal")


def draw_arm(axes, q, **style):
    joints = np.asarray(ControlPoints(arm, links, np.zeros((3, 3)))(jnp.asarray(q)))
    axes.plot(*np.concatenate([joints, np.asarray(tip(jnp.asarray(q)))])[:, :2].T, **style)


figure, (left, right) = plt.subplots(1, 2)
draw_world(left, numbers(world))
for i, (goal, (path, hand, clearance)) in enumerate(zip(GOALS, runs, strict=True)):
    left.plot(*np.asarray(hand).T, color=f"C{i}")
    left.plot(*goal, "x", color=f"C{i}")
    draw_arm(left, path.q[-1], color=f"C{i}", alpha=0.5, linewidth=3)
    right.plot(path.time, np.asarray(clearance) * 1e3, color=f"C{i}")
draw_arm(left, START, color="k", linewidth=3)
left.set(xlabel="x (m)", ylabel="y (m)", title="hand and arm")
right.set(xlabel="time (s)", ylabel="smallest distance (mm)", title="clearance of the arm")
plt.show()

# %% [markdown]
# ## Another world, the same program
#
# A second sphere appears beside the goal, the box goes, the capsule moves: nothing is compiled again. The energy of the
# tree never rises by more than rounding and the step's error, and the inspector says which leaf does what at the end.

# %%
changed = World(
    spheres=Spheres.of([([0.35, -0.75, 0.0], 0.15), ([0.8, 0.9, 0.0], 0.12)], capacity=2),
    boxes=Boxes.of([], capacity=1),
    capsules=Capsules.of([([0.2, 0.7, 0.0], [0.2, 0.9, 0.0], 0.06)], capacity=1),
    half_spaces=world.half_spaces,
)
path, hand, clearance = move(jnp.asarray(GOALS[0]), numbers(changed))
tree = policy(jnp.asarray(GOALS[0]), numbers(changed))
rise = float(np.diff(path.energy).max() / np.ptp(path.energy))
print(f"left {np.linalg.norm(hand[-1] - GOALS[0]) * 1e3:.1f} mm, clearance {clearance.min() * 1e3:.1f} mm,")
print(f"energy rises by at most {rise:.1e} of its range in a step; compiled {len(compiled)} time(s)")
middle = len(path.time) // 8
print(inspection.table(inspection.inspect(tree, path.q[middle], path.qd[middle])))
print(jax.jit(jaxrmp.certificate)(tree, path.q[middle], path.qd[middle]))

# %%
assert len(compiled) == 1
assert all(np.linalg.norm(hand[-1] - goal) < 0.01 for goal, (_, hand, _) in zip(GOALS, runs, strict=True))
assert all(c.min() > 0 for _, _, c in runs) and clearance.min() > 0
assert rise < 1e-3 and not jaxrmp.uncertified_leaves(tree)
