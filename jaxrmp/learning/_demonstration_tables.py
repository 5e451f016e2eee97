"""What demonstrations are read from: CSV tables, a header, then one line per sample; and the arrays of NPZ files."""

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from .._errors import DemonstrationError, RigidTransformError
from .._files import read_npz
from .._rotations import pose, rotation_of_quaternion
from ._demonstrations import Demonstration

_POSE = ("_x", "_y", "_z", "_qw", "_qx", "_qy", "_qz")


def read_arrays(file: Path) -> dict[str, np.ndarray]:
    """The arrays of an NPZ file by name. **Raises** `DemonstrationError`, naming the file, for one that is no such."""
    try:
        return read_npz(file)
    except (OSError, ValueError) as error:
        raise DemonstrationError(
            f"{file} is not readable as an NPZ file of plain arrays: {error}. Write it with numpy.savez."
        ) from error


def read_table(file: Path, joint_names: tuple[str, ...] | None) -> tuple[Demonstration, tuple[str, ...]]:
    """Read one CSV demonstration (columns as in `load_demonstrations`).

    **Arguments**: `joint_names`, the order wanted; by default that of the columns.
    **Returns** the demonstration and the names of its joints in order.
    **Raises** `DemonstrationError`, naming file and line; `RigidTransformError` for a quaternion not of unit length.
    """
    column = read_numbers(file)
    if next(iter(column), "") != "time":
        raise DemonstrationError(f"{file}: the header is {list(column)[:8]}, expected time, then the joints by name.")
    poses, taken = object_poses(file, column)
    found = tuple(name for name in column if name not in {"time", *taken})
    if joint_names is not None and set(found) != set(joint_names):
        extra = [name for name in found if name not in joint_names]
        raise DemonstrationError(
            f"{file}: the joint columns are {list(found)}, expected {list(joint_names)} (meta.json, or the first file)."
            + (f" Leave out the columns {extra}, or name them everywhere." if extra else "")
        )
    joint_names = joint_names or found
    if not joint_names:
        raise DemonstrationError(f"{file}: the header {list(column)} names no joint.")
    return Demonstration(column["time"], np.stack([column[name] for name in joint_names], axis=1), poses), joint_names


def read_numbers(file: Path) -> dict[str, np.ndarray]:
    """The columns [T] of a CSV file by their names. **Raises** `DemonstrationError`, naming file and line."""
    header, rows = _read(file)
    if double := [name for name in header if header.count(name) > 1]:
        raise DemonstrationError(f"{file}: the header names {double[0]!r} twice.")
    return dict(zip(header, _numbers(file, header, rows).T, strict=True))


def object_poses(file: Path, column: Mapping[str, np.ndarray]) -> tuple[dict[str, np.ndarray], list[str]]:
    """Poses [T, 4, 4] of objects that have columns OBJECT_x, ..., OBJECT_qz; and the names of these columns.

    **Raises** as `read_table`.
    """
    poses, taken = {}, []
    for name in (name[:-3] for name in column if name.endswith("_qw")):
        columns = [name + suffix for suffix in _POSE]
        if absent := [c for c in columns if c not in column]:
            raise DemonstrationError(f"{file}: the pose of {name!r} lacks the column {absent[0]!r}.")
        poses[name] = _poses(file, name, np.stack([column[c] for c in columns], axis=1))
        taken += columns
    return poses, taken


def _read(file: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    try:
        with open(file, newline="", encoding="utf-8-sig") as stream:
            reader = csv.reader(stream)
            lines = [(reader.line_num, [entry.strip() for entry in row]) for row in reader if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DemonstrationError(f"{file} is not readable as a CSV file: {error}.") from error
    return (lines[0][1], lines[1:]) if lines else ([], [])


def _numbers(file: Path, header: list[str], rows: list[tuple[int, list[str]]]) -> np.ndarray:
    table = np.empty((len(rows), len(header)))
    for i, (line, row) in enumerate(rows):
        if len(row) != len(header):
            raise DemonstrationError(f"{file}, line {line}: {len(row)} entries, but the header has {len(header)}.")
        for j, entry in enumerate(row):
            try:
                table[i, j] = float(entry)
            except ValueError:
                raise DemonstrationError(f"{file}, line {line}: {entry!r} is not a number.") from None
    return table


def _poses(file: Path, name: str, entries: np.ndarray) -> np.ndarray:
    """Positions and quaternions (w, x, y, z) [T, 7] as poses [T, 4, 4]."""
    length = np.linalg.norm(entries[:, 3:], axis=1)
    bad = np.flatnonzero(~(np.abs(length - 1.0) < 1e-2))
    if bad.size:
        raise RigidTransformError(
            f"{file}: the pose of {name!r} at sample {bad[0]} is no rigid transform: its quaternion has length "
            f"{length[bad[0]]:.4g}, expected 1."
        )
    return pose(entries[:, :3], rotation_of_quaternion(entries[:, 3:]))
