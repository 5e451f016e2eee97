"""Demonstration sets in folders: NPZ files with a meta.json, or CSV files; NPZ is also what is written."""

import json
import os
import re
import shutil
import uuid
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import DemonstrationError
from .._files import names_in_npz
from .._rotations import pose
from ._demonstration_tables import read_arrays, read_table
from ._demonstrations import JOINT_UNITS, Demonstration, DemonstrationSet, check_demonstration, check_poses
from ._recording import Open, RecordingSettings, chosen_episodes, name_columns, stated

NAME = re.compile(r"demo_(\d+)\.(npz|csv)")
_READ = {"robot", "joint_names", "units", "num_demos", "objects", "source", "notes"}
_ARRAYS = ("time", "joint_positions", "gripper_positions")  # the last left out without a word
_LOGGED = "log_"  # of a drive's other columns, left out without a word
_BASE, _POSE = "pose_world_base", "pose_world_"
_LAYOUT = (
    "Expected demo_0.npz, demo_1.npz, ... with meta.json, or demo_0.csv, demo_1.csv, ...; or a LeRobotDataset, ROS "
    "bags, or one HDF5 file of robomimic."
)


def read_folder(folder: Path, recording: RecordingSettings, told: list[str]) -> DemonstrationSet:
    """What `demo_K.npz` files with meta.json, or `demo_K.csv` files, hold; raises as `load_demonstrations`."""
    files = numbered_files(folder, _LAYOUT)
    meta = read_meta(folder / "meta.json", required=files[0].suffix == ".npz")
    read = _read_npz if files[0].suffix == ".npz" else read_table
    if meta.get("num_demos", len(files)) != len(files):
        raise DemonstrationError(
            f"{folder / 'meta.json'} says num_demos = {meta['num_demos']}, but the folder holds {len(files)}: "
            f"{[file.name for file in files]}."
        )
    joint_names = tuple(meta["joint_names"]) if "joint_names" in meta else None
    demonstrations = []
    chosen = [files[k] for k in chosen_episodes(recording, range(len(files)), folder)]
    for file in chosen:
        demonstration, joint_names = read(file, joint_names)
        check_demonstration(demonstration, joint_names, str(file))
        absent = [name for name in meta.get("objects", ()) if name not in demonstration.poses]
        if absent:
            raise DemonstrationError(
                f"{file} has no pose of {absent[0]!r}, which meta.json lists under objects. It has "
                f"{list(demonstration.poses) or 'none'}."
            )
        if recording.rate:
            demonstration = replace(demonstration, time=np.arange(len(demonstration.q)) / recording.rate)
        demonstrations.append(demonstration)
    names = name_columns(["joints"], {"joints": joint_names or ()}, recording, None, folder, told)
    said = _units(meta, folder / "meta.json")
    (units,) = stated(recording, folder / "meta.json", units=Open(said, JOINT_UNITS))
    if unread := sorted(set(meta) - _READ):
        told.append(f"{unread} of meta.json are not read; {sorted(_READ)} are.")
    arrays = names_in_npz(chosen[0]) if chosen[0].suffix == ".npz" else ()
    if unread := [name for name in arrays if name not in _ARRAYS and not name.startswith((_POSE, _LOGGED))]:
        told.append(f"arrays {unread} of {chosen[0].name} are not read; time, joint_positions and {_POSE}OBJECT are.")
    source, layout = str(meta.get("source", folder.name)), f"{len(files)} files {files[0].suffix}"
    return DemonstrationSet(tuple(demonstrations), names, str(meta.get("robot", "unknown")), source, units, layout)


def save_demonstrations(demonstrations: DemonstrationSet, path: str | os.PathLike, overwrite: bool = False) -> Path:
    """Write `demonstrations` as a folder of `demo_K.npz` and `meta.json`, complete or not at all.

    **Arguments**: `path`, the folder; `overwrite`, replace one that holds demonstrations already, never another.
    **Returns** the folder. `load_demonstrations` gives back equal numbers.
    **Raises** `DemonstrationError` if the folder is not empty and may not be replaced.
    """
    folder = Path(path)
    check_replaceable(folder, overwrite)
    folder.parent.mkdir(parents=True, exist_ok=True)
    new = folder.parent / f".{folder.name}.{uuid.uuid4().hex[:8]}.partial"
    new.mkdir()
    try:
        for k, demonstration in enumerate(demonstrations):
            poses: dict[str, Any] = {f"{_POSE}{name}": T for name, T in demonstration.poses.items()}
            np.savez(new / f"demo_{k}.npz", time=demonstration.time, joint_positions=demonstration.q, **poses)
        meta = {
            "robot": demonstrations.robot,
            "joint_names": list(demonstrations.joint_names),
            "units": {
                "time": "s",
                "joint_positions": demonstrations.units,
                "pose": "homogeneous 4x4, metres, in the base frame",
            },
            "num_demos": len(demonstrations),
            "objects": list(demonstrations.object_names),
            "source": demonstrations.source,
        }
        (new / "meta.json").write_text(json.dumps(meta, indent=2) + "\n", encoding="utf-8")
        if folder.is_dir() and any(folder.iterdir()):
            old = new.with_suffix(".old")
            folder.rename(old)
            try:
                new.rename(folder)
            except BaseException:
                old.rename(folder)
                raise
            shutil.rmtree(old)
        else:
            new.rename(folder)
    finally:
        shutil.rmtree(new, ignore_errors=True)
    return folder


def numbered_files(folder: Path, layout: str) -> list[Path]:
    """The files demo_K in the order of K; **raises** `DemonstrationError` if there are none, or of two kinds."""
    if not folder.exists():
        raise DemonstrationError(f"{folder} does not exist. {layout}")
    if not folder.is_dir():
        raise DemonstrationError(f"{folder} is a file: give the folder that holds the demonstrations. {layout}")
    numbered = {}
    for file in folder.iterdir():
        if match := NAME.fullmatch(file.name):
            numbered.setdefault(match[2], {}).setdefault(int(match[1]), []).append(file)
    if not numbered:
        found = sorted(entry.name for entry in folder.iterdir())[:10]
        raise DemonstrationError(f"no demonstrations in {folder}, which holds {found or 'nothing'}. {layout}")
    if len(numbered) > 1:
        raise DemonstrationError(f"{folder} holds demonstrations both as .npz and as .csv: keep one kind.")
    (files,) = numbered.values()
    twice = [k for k, same in files.items() if len(same) > 1]
    if twice:
        raise DemonstrationError(
            f"{folder} numbers two demonstrations {twice[0]}: {[f.name for f in files[twice[0]]]}."
        )
    return [files[k][0] for k in sorted(files)]


def read_meta(file: Path, required: bool) -> dict[str, Any]:
    """What a meta.json says, nothing if there is none and none is `required`; **raises** `DemonstrationError`."""
    if not file.exists() and not required:
        return {}
    try:
        meta = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise DemonstrationError(
            f'{file} is missing. Write one with at least {{"robot": ..., "joint_names": [...]}}.'
        ) from error
    except (OSError, ValueError) as error:
        raise DemonstrationError(f"{file} is not readable as JSON: {error}.") from error
    if not isinstance(meta, dict):
        raise DemonstrationError(f"{file} holds a {type(meta).__name__}, expected a JSON object.")
    for key in ("joint_names", "objects"):
        names = meta.get(key, [])
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise DemonstrationError(f"{file}: {key} is {names!r}, expected a list of names.")
    for key in ("robot", "joint_names") if required else ():
        if not meta.get(key):
            raise DemonstrationError(f"{file} has no {key!r}; it has {sorted(meta)}. Add it.")
    return meta


def _units(meta: dict[str, Any], file: Path) -> str:
    """The unit of joints; **raises** `DemonstrationError` for units that cannot be read."""
    units = meta.get("units") or {}
    units = {"joint_positions": units} if isinstance(units, str) else units
    if not isinstance(units, dict):
        raise DemonstrationError(f"{file}: units is {units!r}, expected a unit of joints, or an object of units.")
    known = {"time": ("s", "seconds"), "pose": ("m", "metres"), "joint_positions": (), "gripper_positions": ()}
    for key, unit in units.items():
        if key not in known:
            raise DemonstrationError(f"{file}: units are said of {key!r}; known are {', '.join(known)}.")
        if known[key] and str(unit).removeprefix("homogeneous 4x4, ").split(",")[0] not in known[key]:
            raise DemonstrationError(
                f"{file}: units of {key!r} are {unit!r}, but only {known[key][0]} can be read: convert them."
            )
    said = str(units.get("joint_positions", "rad"))
    return {"deg": "degrees", "degree": "degrees", "radians": "rad"}.get(said, said)


def _read_npz(file: Path, joint_names: tuple[str, ...] | None) -> tuple[Demonstration, tuple[str, ...]]:
    arrays = read_arrays(file)
    absent = [key for key in ("time", "joint_positions") if key not in arrays]
    if absent:
        raise DemonstrationError(f"{file} has no array {absent[0]!r}; it has {sorted(arrays)}.")
    base = arrays.pop(_BASE, None)
    poses = {key.removeprefix(_POSE): T for key, T in arrays.items() if key.startswith(_POSE)}
    try:
        demonstration = Demonstration(arrays["time"], arrays["joint_positions"], poses)
        if base is not None:
            poses = _in_base_frame(demonstration, np.asarray(base, float), str(file))
            demonstration = Demonstration(demonstration.time, demonstration.q, poses)
    except (DemonstrationError, TypeError, ValueError) as error:
        if str(error).startswith(str(file)):
            raise
        raise DemonstrationError(f"{file}: {error}") from error
    return demonstration, joint_names or ()


def _in_base_frame(demonstration: Demonstration, T_world_base: np.ndarray, where: str) -> dict[str, np.ndarray]:
    samples = len(demonstration.q)
    check_poses(T_world_base, samples, f"{where}: {_BASE}")
    for name, T in demonstration.poses.items():
        check_poses(T, samples, f"{where}: the pose of {name!r}")
    R_base_world = np.swapaxes(T_world_base[..., :3, :3], -1, -2)
    T_base_world = pose(-np.einsum("...ij,...j->...i", R_base_world, T_world_base[..., :3, 3]), R_base_world)
    return {name: T_base_world @ T for name, T in demonstration.poses.items()}


def check_replaceable(folder: Path, overwrite: bool) -> None:
    """Check, before the work, that `save_demonstrations` will write to `folder`, with `overwrite` or without.

    **Raises** `DemonstrationError`.
    """
    if not folder.exists():
        return
    if not folder.is_dir():
        raise DemonstrationError(f"{folder} is a file: give a folder to write demonstrations to.")
    there = sorted(entry.name for entry in folder.iterdir())
    if not there:
        return
    others = [name for name in there if name != "meta.json" and not NAME.fullmatch(name)]
    if others:
        raise DemonstrationError(
            f"{folder} holds other things than demonstrations ({others[:5]}) and is left alone: choose another folder."
        )
    if not overwrite:
        raise DemonstrationError(f"{folder} is not empty: choose another folder, or say overwrite=True (--overwrite).")
