"""Pose and Jacobian of the Panda's hand by us and by the peers that are installed, in one run, checked to be equal."""

import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp.kinematics import PANDA_MODEL, forward_kinematics, geometric_jacobian, panda
from jaxrmp.xla import own_cores

from ._children import in_child
from ._plots import bars
from ._policies import states
from ._timing import alternately, ratio
from ._urdf import urdf_chain

HAND, BATCH, CHECKED, AGREE = "panda_hand", 4096, 64, 1e-5
TASKS = ("fk", "fk+jacobian")
Calls = dict[str, Callable[[np.ndarray], Any]]


def rows(quick: bool = False) -> list[dict[str, Any]]:
    """One row a library and task, in float32: a single call, and a configuration of a batch of 4,096.

    `fk` is the hand's pose alone, `fk+jacobian` with the 6 x 7 geometric Jacobian. Each is checked against ours, in
    float32, to 1e-5 before it is timed; calls take turns. MJX runs in a child process.
    """
    batch = 64 if quick else BATCH
    found = []
    mjx = in_child("benchmarks.kinematics:mjx_rows", batch, quick)
    with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
        file.write(urdf_chain(panda(), HAND))
        file.flush()
        libraries = {"jaxrmp": ours(), **frax(Path(file.name)), **pytorch_kinematics(Path(file.name))}
    for task in TASKS[-1:] if quick else TASKS:
        calls = {name: library[task] for name, library in libraries.items()}
        found += _compared(task, calls, batch, quick)
        ours_us = {c: found[-len(calls)][c] for c in ("single_us", "batch_us")}
        row = mjx[task]
        found.append(row | {"times_ours": row["batch_us"] / ours_us["batch_us"]})
    return found


def figure(found: list[dict[str, Any]]) -> Any:
    """Time a configuration."""
    return bars(found, ("single_us", "batch_us"), "microseconds a configuration")


def ours() -> Calls:
    """By `forward_kinematics` and `geometric_jacobian`."""
    robot = panda()

    def pose(q):
        return forward_kinematics(robot, q, HAND)[:3]

    def pose_and_jacobian(q):
        return pose(q), geometric_jacobian(robot, q, HAND)

    return _of_jax({"fk": pose, "fk+jacobian": pose_and_jacobian})


def frax(urdf: Path) -> dict[str, Calls]:
    """frax, where it is installed."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of settings that matter in float64 and on several cores
            from frax.core.manipulator import Manipulator
    except ImportError:
        return {}
    robot = panda()
    T_last_hand = _fixed_after(robot, "panda_link7")
    arm = Manipulator(str(urdf), ee_offset=T_last_hand)

    def both(q):
        J, T = arm.velocity_control_matrices(q)
        return T[:3], J

    return {"frax": _of_jax({"fk": lambda q: arm.ee_transform(q)[:3], "fk+jacobian": both})}


def pytorch_kinematics(urdf: Path) -> dict[str, Calls]:
    """pytorch-kinematics, where it is installed, on as many threads as this process has cores."""
    try:
        import pytorch_kinematics as pk
        import torch
    except ImportError:
        return {}
    torch.set_num_threads(own_cores())  # it counts the machine's, and threads that share a core wait for each other
    chain = pk.build_serial_chain_from_urdf(urdf.read_bytes(), HAND)

    def fk(q):
        pose: Any = chain.forward_kinematics(torch.from_numpy(q))
        return pose.get_matrix()[..., :3, :]

    def both(q):
        J, pose = chain.jacobian(torch.from_numpy(q), ret_eef_pose=True)
        return (pose if isinstance(pose, torch.Tensor) else pose.get_matrix())[..., :3, :], J

    return {"pytorch-kinematics": {"fk": torch.no_grad()(fk), "fk+jacobian": torch.no_grad()(both)}}


def mjx_rows(batch: int, quick: bool) -> dict[str, dict[str, Any]]:
    """MJX, in a process of its own; the same checks against ours."""
    from jaxrmp.kinematics._mujoco import import_mujoco
    from jaxrmp.simulation._engine_mjx import import_mjx, mjx_compiler_options

    mjx = import_mjx()
    spec = import_mujoco().MjSpec.from_file(str(PANDA_MODEL))
    model = spec.compile()
    hand = model.body(HAND).id
    joints = np.array([model.joint(name).qposadr[0] for name in panda().joint_names])
    rest = np.array(model.qpos0)
    device_model, data = mjx.put_model(model), mjx.make_data(model)

    def moved(q):
        placed = data.replace(qpos=jnp.asarray(rest, q.dtype).at[joints].set(q))
        return mjx.kinematics(device_model, placed)

    def fk(q):
        d = moved(q)
        return jnp.column_stack([d.xmat[hand], d.xpos[hand]])

    def both(q):
        d = mjx.com_pos(device_model, moved(q))
        jacp, jacr = mjx.jac(device_model, d, d.xpos[hand], hand)
        return jnp.column_stack([d.xmat[hand], d.xpos[hand]]), jnp.concatenate([jacp.T, jacr.T])[:, joints]

    library, reference = _of_jax({"fk": fk, "fk+jacobian": both}, mjx_compiler_options()), ours()
    found = {}
    for task in TASKS[-1:] if quick else TASKS:
        call = library[task]
        _check(f"mjx {task}", call, reference[task])
        found[task] = _compared(task, {"mjx": call}, batch, quick)[0]
    return found


def _fixed_after(robot: Any, frame: str) -> np.ndarray:
    """The pose of the hand in `frame`, which it is fixed to."""
    from jaxrmp.kinematics import frame_poses

    T = np.asarray(frame_poses(robot, jnp.zeros(robot.num_joints), (frame, HAND)), float)
    return np.linalg.inv(T[0]) @ T[1]


def _of_jax(functions: dict[str, Callable], options: dict[str, Any] | None = None) -> Calls:
    def call_of(function):
        one, many = (jax.jit(f, compiler_options=options) for f in (function, jax.vmap(function)))
        return lambda q: jax.block_until_ready((many if q.ndim > 1 else one)(q))

    return {task: call_of(function) for task, function in functions.items()}


def _compared(task: str, calls: Calls, batch: int, quick: bool) -> list[dict[str, Any]]:
    Q, _ = states(batch)
    names = list(calls)
    for name in names[1:]:
        _check(f"{name} {task}", calls[name], calls[names[0]])
    rounds, least = (2, 0.0) if quick else (21, 0.05)
    single = alternately({name: lambda c=c: c(Q[0]) for name, c in calls.items()}, rounds, least)
    many = alternately({name: lambda c=c: c(Q) for name, c in calls.items()}, rounds, least)
    return [
        {
            "name": f"{name} {task}",
            "library": name,
            "task": task,
            "single_us": float(np.median(single[name])),
            "batch_us": float(np.median(many[name])) / batch,
            "per_second": 1e6 * batch / float(np.median(many[name])),
            "times_ours": ratio(many[name], many[names[0]]),
        }
        for name in names
    ]


def _check(name: str, call: Callable, reference: Callable) -> None:
    """**Raises** `RuntimeError` where the two differ by more than `AGREE`."""
    Q, _ = states(CHECKED)
    for one, other in zip(_arrays(call(Q)), _arrays(reference(Q)), strict=True):
        if (worst := float(np.abs(one - other).max())) > AGREE:
            raise RuntimeError(f"{name} differs from jaxrmp by {worst:.1e}, more than {AGREE:.0e}.")


def _arrays(found: Any) -> list[np.ndarray]:
    return [np.asarray(a) for a in (found if isinstance(found, tuple) else (found,))]
