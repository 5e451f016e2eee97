"""Poses of the hand from files: one NPZ file of all demonstrations, or a folder of NPZ or CSV files, one each."""

import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import DemonstrationError, FileWarning, RigidTransformError
from .._files import names_in_npz
from ._demonstration_files import numbered_files, read_meta
from ._demonstration_tables import object_poses, read_arrays, read_numbers
from ._pose_demonstrations import PoseDemonstration, PoseDemonstrationSet
from ._recording import METRES, QUATERNIONS, Open, RecordingSettings, chosen_episodes, in_natural_order, stated

_POSITION, _QUATERNION = ("positions", "position"), ("quaternions", "quaternion")
_HEADER = ("x", "y", "z", "qw", "qx", "qy", "qz")
_SCALED = np.array([[0, 0, 0, 1]] * 3 + [[0] * 4])  # of a pose [4, 4] what is a length
_RATE = 100.0  # samples a second, of poses that say no time
_LAYOUT = (
    "Expected an .npz file with positions_0, quaternions_0, ... (and time_0, ...), or a folder of demo_0.npz, ... with "
    "positions, quaternions and time, or of demo_0.csv, ... with the columns time, x, y, z, qw, qx, qy, qz."
)


def load_poses(path: str | os.PathLike, recording: RecordingSettings | None = None) -> PoseDemonstrationSet:
    """Read demonstrations of the hand's pose in the robot's base frame, without joints, from the file or folder `path`.

    An NPZ file with `positions_K` [T, 3], `quaternions_K` [T, 4] and optional `time_K` [T], s, for each demonstration
    K; or a folder of `demo_K.npz` with `positions`, `quaternions` and `time`, and `pose_base_OBJECT`, [4, 4] or [T, 4,
    4]; or of `demo_K.csv` with columns `time`, `x, y, z`, `qw, qx, qy, qz`, and poses of objects as in
    `load_demonstrations`, in the same unit. In a folder, meta.json may say `units` (m, cm or mm) and `quaternion` (wxyz
    or xyzw).

    **Arguments**: `recording`, its `units` and `quaternion`, which must be said there if the file does not; `rate`, of
    poses without time, else 100 a second, of which a `FileWarning` tells; `episodes`.
    **Returns** a `PoseDemonstrationSet`, in m and (w, x, y, z), quaternions without flips of their sign.
    **Raises** `DemonstrationError`, naming the file, if something is missing, not said, unreadable or does not fit
    together; `RigidTransformError` for what is no rotation.
    """
    path, recording = Path(path), recording or RecordingSettings()
    meta: dict[str, Any] = {}
    if path.is_dir():
        files = numbered_files(path, _LAYOUT)
        meta = read_meta(path / "meta.json", required=False)
        read = _table if files[0].suffix == ".csv" else _arrays
        numbers = chosen_episodes(recording, range(len(files)), path)
        found = [(files[k], *read(files[k])) for k in numbers]
    else:
        found = [(f"{path}, demonstration {k}", *entry) for k, entry in _all_in_one(path, recording)]
    largest = max(float(np.abs(position).max(initial=0.0)) for _, _, position, _, _, _ in found)
    asked = {"units": Open(str(meta.get("units", "")), tuple(METRES), f"the largest coordinate is {largest:.4g}")}
    if not all(order for *_, order, _ in found):  # columns with names say it themselves
        asked["quaternion"] = Open(str(meta.get("quaternion", "")), QUATERNIONS)
    units, *turn = stated(recording, path, **asked)
    scale = METRES[units]
    told = []
    demonstrations = []
    for where, time, position, quaternion, order, poses in found:
        order = order or turn[0]
        if time is None or recording.rate:
            if not recording.rate:
                told.append(f"there is no time: samples are taken {_RATE:g} a second. recording.rate says otherwise.")
            time = np.arange(len(position)) / (recording.rate or _RATE)
        if order == "xyzw":
            quaternion = np.roll(quaternion, 1, axis=-1)
        try:
            poses = {name: np.asarray(T, float) * np.where(_SCALED, scale, 1.0) for name, T in poses.items()}
            demonstrations.append(PoseDemonstration(time, scale * np.asarray(position, float), quaternion, poses))
        except (DemonstrationError, RigidTransformError) as error:
            raise type(error)(f"{where}: {error}") from error
    if told:
        warnings.warn(f"{path}: {told[0]}", FileWarning, stacklevel=2)
    layout = f"poses, {len(found)} demonstrations, positions in m times {scale:g}, quaternions {order}"
    return PoseDemonstrationSet(tuple(demonstrations), str(meta.get("source", path.name)), layout)


def is_poses(path: Path) -> bool:
    """Whether `path` holds poses of a hand and no joints, as `load_poses` reads; not if it cannot be read."""
    try:
        if path.suffix == ".npz":
            names = names_in_npz(path)
            return "joint_positions" not in names and all(
                any(name.startswith(of) for name in names) for of in (_POSITION, _QUATERNION)
            )
        file = min(path.glob("demo_*.[nc][ps][zv]"), key=in_natural_order)
        if file.suffix == ".csv":
            with open(file, encoding="utf-8-sig") as table:
                header = {name.strip() for name in table.readline().split(",")}
            objects = {name.removesuffix("_qw") for name in header if name.endswith("_qw")}
            others = {name for name in header if name.rpartition("_")[0] not in objects}  # else joints
            return set(_HEADER) <= others <= {"time", *_HEADER}
        return is_poses(file)
    except (OSError, ValueError):
        return False


def _all_in_one(path: Path, recording: RecordingSettings) -> list[tuple[int, tuple[Any, ...]]]:
    arrays = read_arrays(path)
    keys = sorted((key for key in arrays if key.startswith("positions_")), key=in_natural_order)
    by_number = {int(key[10:]): arrays[key] for key in keys if key[10:].isdigit()}
    if not by_number:
        raise DemonstrationError(f"{path} has no positions_0, ...; it has {sorted(arrays)[:10]}. {_LAYOUT}")
    found = []
    for k in chosen_episodes(recording, list(by_number), path):
        if f"quaternions_{k}" not in arrays:
            raise DemonstrationError(f"{path} has positions_{k} but no quaternions_{k}: give the hand's turn as well.")
        found.append((k, (arrays.get(f"time_{k}"), by_number[k], arrays[f"quaternions_{k}"], "", {})))
    return found


def _arrays(file: Path) -> tuple[Any, ...]:
    arrays = read_arrays(file)
    named = [next((arrays[n] for n in names if n in arrays), None) for names in (_POSITION, _QUATERNION)]
    if any(a is None for a in named):
        raise DemonstrationError(f"{file} has {sorted(arrays)}, expected positions and quaternions. {_LAYOUT}")
    poses = {key.removeprefix("pose_base_"): T for key, T in arrays.items() if key.startswith("pose_base_")}
    return arrays.get("time"), *named, "", poses


def _table(file: Path) -> tuple[Any, ...]:
    column = read_numbers(file)
    if absent := [name for name in _HEADER if name not in column]:
        raise DemonstrationError(f"{file} has the columns {list(column)}; {absent[0]!r} is missing. {_LAYOUT}")
    position, quaternion = (np.stack([column[c] for c in part], axis=1) for part in (_HEADER[:3], _HEADER[3:]))
    poses, _ = object_poses(file, column)
    return column.get("time"), position, quaternion, "wxyz", poses
