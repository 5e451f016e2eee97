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
# # Your own robot and your own demonstrations
#
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/)
# (upload it there, into a clone of jaxrmp)
#
# From nothing to a learned skill: a robot's URDF, a folder of demonstrations as CSV files, and a TOML file of a dozen
# lines. All three are written here, as you would write yours; the demonstrations come from a formula, so no person moved
# an arm. About half a minute on two cores.
#
# Without demonstrations, an arm reaches poses and avoids obstacles by `policies.reaching_policy`, in three lines (the
# guide to a new robot), or as NVIDIA's files say, by `io.load_lula`.

# %% tags=["skip-execution"]
# %pip install --quiet "..[learning,plots]"  # the clone of jaxrmp that this notebook lies in

# %%
import csv
import tempfile
from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np

from jaxrmp import kinematics, learning, visualization

# Compiled programs are kept between runs; the library itself never switches this on.
jax.config.update("jax_compilation_cache_dir", str(Path(tempfile.gettempdir()) / "jaxrmp_notebooks"))
plt.rcParams.update(visualization.figure_style())

folder = Path(tempfile.mkdtemp())

# %% [markdown]
# ## The robot
#
# A SCARA arm: two joints in the plane, a lift, and a wrist that turns the tool. No mesh and no inertia is needed.

# %%
(folder / "scara.urdf").write_text("""
<robot name="scara">
  <link name="base"/><link name="upper"/><link name="fore"/><link name="quill"/><link name="tool"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.4"/>
    <axis xyz="0 0 1"/><limit lower="-2.4" upper="2.4" velocity="3" effort="50"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.35 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-2.6" upper="2.6" velocity="3" effort="50"/></joint>
  <joint name="lift" type="prismatic"><parent link="fore"/><child link="quill"/><origin xyz="0.3 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-0.35" upper="0.05" velocity="1" effort="50"/></joint>
  <joint name="wrist" type="revolute"><parent link="quill"/><child link="tool"/>
    <axis xyz="0 0 1"/><limit lower="-3.1" upper="3.1" velocity="5" effort="10"/></joint>
</robot>
""")
robot = kinematics.load_robot(folder / "scara.urdf")
tool = kinematics.ControlPoints(robot, "tool")
print(robot.joint_names, robot.frame_names)
assert np.allclose(tool(np.zeros(4))[0], [0.65, 0.0, 0.4], atol=1e-6)  # check what you know of your robot first

# %% [markdown]
# ## The demonstrations
#
# Five, each to another place of a cup: up, across, and down on to it. A file has a header and a line a sample: `time`, the
# joints by name, and the cup's pose in the base frame. Stamps may be uneven, and here they are noisy, as recordings are.

# %%
UPPER, FORE, HEIGHT = 0.35, 0.3, 0.4
rng = np.random.default_rng(0)


def joints_at(position, yaw):
    """Where the joints are with the tool at `position` [T, 3], turned by `yaw` [T]; elbow to the left."""
    x, y, z = position.T
    elbow = np.arccos((x**2 + y**2 - UPPER**2 - FORE**2) / (2 * UPPER * FORE))
    shoulder = np.arctan2(y, x) - np.arctan2(FORE * np.sin(elbow), UPPER + FORE * np.cos(elbow))
    return np.stack([shoulder, elbow, z - HEIGHT, yaw - shoulder - elbow], axis=1)


(folder / "demonstrations").mkdir()
for k in range(5):
    cup = np.array([0.35, 0.25, 0.12]) + rng.uniform(-1, 1, 3) * [0.05, 0.05, 0.0]
    start = np.array([0.3, -0.3, 0.2]) + rng.uniform(-0.03, 0.03, 3)
    time = np.cumsum(rng.uniform(0.02, 0.045, 120))
    s = 0.5 - 0.5 * np.cos(np.pi * (time - time[0]) / (time[-1] - time[0]))  # slow, fast, slow
    path = start + s[:, None] * (cup - start)
    path[:, 0] += 0.06 * np.sin(np.pi * s)
    path[:, 2] += 0.12 * np.sin(np.pi * s) ** 1.5
    q = joints_at(path, 0.8 * s) + rng.normal(0.0, 2e-4, (len(s), 4))
    with open(folder / "demonstrations" / f"demo_{k}.csv", "w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["time", *robot.joint_names, *(f"cup_{c}" for c in ("x", "y", "z", "qw", "qx", "qy", "qz"))])
        writer.writerows([t, *row, *cup, 1, 0, 0, 0] for t, row in zip(time, q, strict=True))

print("".join((folder / "demonstrations" / "demo_0.csv").read_text().splitlines(keepends=True)[:2]))

# %% [markdown]
# ## The configuration
#
# The robot's file, the object in whose frame the skill lives, and its control points: the tool's centre, and a point
# beside it, so that the way the tool turns is learned too.

# %%
_ = (folder / "over_the_cup.toml").write_text("""
name = "over_the_cup"
robot = "scara.urdf"
object = "cup"

[[subtasks]]
name = "tool"
frame = "tool"

[[subtasks]]
name = "beside"
frame = "tool"
offset = [0.06, 0.0, 0.0]

[flow]
updates = 800
""")

# %% [markdown]
# ## Learning
#
# On the command line, this cell and the next are
#
# ```
# jaxrmp learn over_the_cup.toml --demos demonstrations --out out
# jaxrmp reproduce out/over_the_cup.skill.npz
# ```

# %%
configuration = learning.load_configuration(folder / "over_the_cup.toml")
demonstrations = learning.load_demonstrations(folder / "demonstrations")
learned = learning.learn(configuration, robot, demonstrations)
for k, report in enumerate(learned.prepared.joints.reports):
    print(f"demonstration {k}: {report.samples_read} samples, {report.duration:.1f} s, {report.gaps} gaps")

# %% [markdown]
# ## Reproduction, and a cup that was never shown
#
# The cup stands 8 cm further on, higher, and turned: the whole way turns with it.

# %%
skill = learned.skill
reproduction = learning.reproduce(skill, robot, learned.prepared, duration=12.0, dt=0.01)
turn = 0.5
poses = learned.prepared.poses.copy()
poses[:, :2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
poses[:, :3, 3] += [0.04, 0.07, 0.04]
moved = learning.reproduce(skill, robot, learned.prepared._replace(poses=poses), duration=12.0, dt=0.01)
left = np.linalg.norm(moved.points[:, -1] - learned.prepared.subtasks.ends, axis=-1)
print({name: round(value, 3) for name, value in reproduction.mean.items() if value is not None})
print("new place of the cup: left to the targets, mm", np.round(1e3 * left.max(axis=1), 1))

figure, panels = plt.subplots(1, 2, sharex=True)
shown = {"shown": (learned.prepared.points, "darkgrey"), "reproduced": (reproduction.points, "C0")}
for name, (points, color) in {**shown, "at the new place": (moved.points, "C1")}.items():
    for k, path in enumerate(points):
        panels[0].plot(*path[:, 0, :2].T, color=color, label=None if k else name)
        panels[1].plot(*path[:, 0, ::2].T, color=color)
panels[0].set(xlabel="x (m)", ylabel="y (m)", title="from above, in the cup's frame")
panels[1].set(xlabel="x (m)", ylabel="z (m)", title="from the side")
figure.legend(loc="outside lower center", ncols=3)
plt.show()

# %%
assert len(demonstrations) == 5 and demonstrations.joint_names == robot.joint_names
assert reproduction.mean["dtw_cm"] < 1.5 and reproduction.mean["goal_cm"] < 0.3
assert min(errors["limit_margin_rad"] for errors in (*reproduction.errors, *moved.errors)) > 0
assert left.max() < 0.01
