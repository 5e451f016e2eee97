"""Every cycle of a drive, kept in memory allocated before it, and written as files that other things read."""

import json
import re
import shutil
import uuid
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import DemonstrationError, importing
from .._files import atomic_write
from .._rotations import quaternion_of_rotation
from ._arm import ArmState
from ._law import Step
from ._sightings import Sighting

PREFIX = "log_"
"""Of the arrays in a log's NPZ file besides those of a demonstration."""
_VECTORS = (
    "velocities",
    "positions_told",
    "velocities_told",
    "accelerations_told",
    "accelerations_wanted",
    "command",
    "external",
)
_NUMBERS = ("dt", "energy", "dissipation", "age", "busy")
_FILE = re.compile(r"demo_(\d+)\.npz")
_POSES = 20  # cycles after which an object's pose is written again, though it has not changed
_WORLD = "world"


class Log:
    """What an arm of `joints` joints did in each of at most `cycles` cycles; `count`, how many there were.

    What comes after the last one is not kept, which `full` says.
    """

    def __init__(self, joints: int, cycles: int):
        self.count, self.full = 0, False
        self._time = np.full(cycles, np.nan)
        self._q = np.full((cycles, joints), np.nan)
        self._vectors = {name: np.full((cycles, joints), np.nan, np.float32) for name in _VECTORS}
        self._numbers = {name: np.full(cycles, np.nan, np.float32) for name in _NUMBERS}
        self._braking = np.zeros(cycles, bool)
        self._T = np.full((cycles, 4, 4), np.nan, np.float32)

    def add(
        self,
        state: ArmState,
        dt: float,
        seen: Sighting,
        step: Step,
        command: np.ndarray,
        braking: bool,
        busy: float,
    ) -> None:
        """A cycle: its `state`; `dt`, s since the last one; what was `seen`; the law's `step`; the `command` that
        was sent; whether the arm is `braking`; `busy`, s from its state to its command."""
        k = self.count
        if k == len(self._time):
            self.full = True
            return
        self._time[k], self._q[k], self._T[k], self._braking[k] = state.time, state.q, seen.T_world_object, braking
        rows = (state.qd, state.q_d, step.qd, step.qdd, step.wanted, command, state.external)
        for name, row in zip(_VECTORS, rows, strict=True):
            self._vectors[name][k] = row
        for name, value in zip(_NUMBERS, (dt, step.energy, step.dissipation, seen.age, busy), strict=True):
            self._numbers[name][k] = value
        self.count = k + 1

    def arrays(self) -> dict[str, np.ndarray]:
        """`time` [T] from zero, s, `joint_positions` [T, n], `T_world_object` [T, 4, 4], and by `log_...`: joint
        `velocities`, positions, velocities and accelerations `told`, accelerations `wanted` by the policy, the
        `command` that was sent, rad/s or N m, `external`
        torques, each [T, n]; `dt`, `energy`, `dissipation`, the `age` of the sighting, s, how long it
        took from a state to its command, `busy`, s, and whether it was `braking`, each [T]; NaN for what there was
        not."""
        kept = slice(self.count)
        found = {"time": self._time[kept] - self._time[0] if self.count else self._time[kept]}
        found |= {"joint_positions": self._q[kept], "T_world_object": self._T[kept].astype(float)}
        rest = {**self._vectors, **self._numbers, "braking": self._braking}
        return found | {PREFIX + name: value[kept] for name, value in rest.items()}


def next_number(folder: Path) -> int:
    """The number of the next `demo_K.npz` in `folder`."""
    names = [entry.name for entry in folder.iterdir()] if folder.is_dir() else []
    return max((int(match[1]) for match in map(_FILE.fullmatch, names) if match), default=-1) + 1


def check_log_folder(folder: Path, robot: str, joint_names: tuple[str, ...], tracked: str) -> None:
    """**Raises** `DemonstrationError` unless motions of `robot`, its name, with its `joint_names`, and with the
    `tracked` object or none, empty, may be added to `folder`."""
    meta = folder / "meta.json"
    if not meta.exists():
        if next_number(folder):
            raise DemonstrationError(f"{folder} holds demonstrations without a meta.json: log to another folder.")
        return
    expected = _meta(robot, joint_names, tracked, 0)
    try:
        found = json.loads(meta.read_text(encoding="utf-8"))
        same = all(found.get(key) == expected[key] for key in ("robot", "joint_names", "objects"))
    except (OSError, ValueError, AttributeError) as error:
        raise DemonstrationError(f"{meta} cannot be read: {error}. Log to another folder.") from error
    if not same:
        raise DemonstrationError(
            f"{folder} holds motions of {found.get('robot')!r} with joints {found.get('joint_names')} and objects "
            f"{found.get('objects')}, not of {robot!r} with {list(joint_names)} and {expected['objects']}: log to "
            "another folder."
        )


def save_motion(
    arrays: dict[str, np.ndarray], folder: Path, robot: str, joint_names: tuple[str, ...], tracked: str = ""
) -> Path:
    """Add a motion to `folder` as its next `demo_K.npz`: what `learning.load_demonstrations` reads.

    **Arguments**: `arrays`, as of `Log.arrays`, `T_world_object` among them if an object was `tracked`; `robot`, its
    name; `joint_names`.
    **Returns** the file. **Raises** as `check_log_folder`.
    """
    check_log_folder(folder, robot, joint_names, tracked)
    number = next_number(folder)
    arrays = dict(arrays)
    T = arrays.pop("T_world_object", None)
    if tracked and T is not None:
        arrays[f"pose_world_{tracked}"] = T
    elif T is not None:
        arrays[f"{PREFIX}T_world_object"] = T
    file = folder / f"demo_{number}.npz"
    with atomic_write(file) as content:
        np.savez_compressed(content, **arrays)
    with atomic_write(folder / "meta.json") as content:
        content.write(json.dumps(_meta(robot, joint_names, tracked, number + 1), indent=2).encode() + b"\n")
    return file


def _meta(robot: str, joint_names: tuple[str, ...], tracked: str, count: int) -> dict[str, Any]:
    return {
        "robot": robot,
        "joint_names": list(joint_names),
        "units": {"time": "s", "joint_positions": "rad", "pose": "homogeneous 4x4, metres, in the world of the model"},
        "num_demos": count,
        "objects": [tracked] if tracked else [],
        "source": "recorded on an arm",
    }


def save_mcap(arrays: dict[str, np.ndarray], folder: Path, joint_names: tuple[str, ...], tracked: str = "") -> Path:
    """Write a motion, `arrays` as of `Log.arrays`, of the joints `joint_names`, as a ROS 2 bag of MCAP, `folder`:
    `sensor_msgs/JointState` at `/joint_states`, measured, and at
    `/joint_commands`, told, and where the `tracked` object is at `/tf`. Stamps count from the motion's start.

    **Raises** `MissingDependencyError` without rosbags, `FileExistsError` if `folder` is there.
    """
    with importing("rosbags", "formats"):
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    if folder.exists():
        raise FileExistsError(17, "is there already", str(folder))
    store = get_typestore(Stores.ROS2_HUMBLE)
    make = store.types
    folder.parent.mkdir(parents=True, exist_ok=True)
    partial = folder.parent / f".{folder.name}.{uuid.uuid4().hex[:8]}.partial"
    partial.mkdir()
    new = partial / folder.name  # whose name its files bear

    def header(nanoseconds: int, frame: str = "") -> Any:
        seconds, rest = divmod(nanoseconds, 10**9)
        stamp = make["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest)
        return make["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)

    def transform(nanoseconds: int, T: np.ndarray) -> Any:
        w, x, y, z = map(float, quaternion_of_rotation(T[:3, :3]))
        moved = make["geometry_msgs/msg/Transform"](
            translation=make["geometry_msgs/msg/Vector3"](*map(float, T[:3, 3])),
            rotation=make["geometry_msgs/msg/Quaternion"](x, y, z, w),
        )
        one = make["geometry_msgs/msg/TransformStamped"](header(nanoseconds, _WORLD), tracked, moved)
        return make["tf2_msgs/msg/TFMessage"](transforms=[one])

    state, tf = "sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage"
    told = arrays.get(f"{PREFIX}positions_told")
    names, poses = list(joint_names), arrays.get("T_world_object", np.zeros((0, 4, 4)))
    columns = (arrays["joint_positions"], arrays.get(f"{PREFIX}velocities"))
    commands = (told, arrays.get(f"{PREFIX}velocities_told"))
    none = np.zeros(0)
    try:
        with Writer(new, version=9, storage_plugin=StoragePlugin.MCAP) as writer:

            def write(connection: Any, nanoseconds: int, message: Any, kind: str) -> None:
                writer.write(connection, nanoseconds, store.serialize_cdr(message, kind))

            measured = writer.add_connection("/joint_states", state, typestore=store)
            commanded = writer.add_connection("/joint_commands", state, typestore=store) if told is not None else None
            seen = writer.add_connection("/tf", tf, typestore=store) if tracked else None
            for k, seconds in enumerate(arrays["time"]):
                at = round(float(seconds) * 1e9)
                for connection, (q, qd) in ((measured, columns), (commanded, commands)):
                    if connection is not None and q is not None:
                        rates = none if qd is None else qd[k].astype(float)
                        message = make[state](header(at), names, q[k].astype(float), rates, none)
                        write(connection, at, message, state)
                if seen is not None and (k % _POSES == 0 or (poses[k] != poses[k - 1]).any()):
                    write(seen, at, transform(at, poses[k]), tf)
        new.rename(folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return folder
