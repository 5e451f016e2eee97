"""Planar paths from files: handwriting and the like, without any robot."""

import os
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import DemonstrationError, importing
from .._files import names_in_npz
from ._demonstration_tables import read_arrays, read_numbers
from ._recording import in_natural_order

_NAMES = ("positions", "position", "pos")
_LAYOUT = (
    "Expected an .npz file of arrays [T, 2] (positions_0, ...), a .mat file of demonstrations with `pos` [2, T], as of "
    "LASA, or a folder of .csv files with columns x and y."
)


def load_paths(path: str | os.PathLike) -> tuple[np.ndarray, ...]:
    """Read planar paths, each [T, 2], as drawn: `path` is an NPZ or MAT file, or a folder of CSV files.

    Of an NPZ file its arrays `positions_K`, else all; of a MAT file the fields `pos` of its demonstrations (or
    `position`, `positions`), [2, T] or [T, 2]; of a CSV file the columns `x` and `y`. What else there is, such as
    times, is not read.
    **Raises** `DemonstrationError`, naming the file, for fewer than two paths, and for arrays that are no paths in the
    plane.
    """
    path = Path(path)
    if not path.exists():
        raise DemonstrationError(f"{path} does not exist. {_LAYOUT}")
    kind = path.suffix.lower()
    if path.is_dir():
        found = {file.name: _of_table(file) for file in sorted(path.glob("*.csv"), key=in_natural_order)}
    elif kind == ".npz":
        arrays = read_arrays(path)
        keys = [key for key in arrays if key.startswith(_NAMES)] or list(arrays)
        found = {key: arrays[key] for key in sorted(keys, key=in_natural_order)}
    elif kind == ".mat":
        found = _of_mat(path)
    else:
        raise DemonstrationError(f"{path} is of no kind that is known. {_LAYOUT}")
    if len(found) < 2:
        raise DemonstrationError(f"{path} holds {len(found)} path(s), but learning needs at least two. {_LAYOUT}")
    return tuple(_as_path(array, f"{path}, {name}") for name, array in found.items())


def is_paths(path: Path) -> bool:
    """Whether the file at `path` holds paths in the plane and no turns, as `load_paths` reads."""
    try:
        if path.suffix.lower() == ".npz":
            names = names_in_npz(path)
            return names != [] and all(name.startswith(_NAMES) for name in names)
        return path.suffix.lower() == ".mat" and path.is_file()
    except (OSError, ValueError):
        return False


def _of_table(file: Path) -> np.ndarray:
    column = read_numbers(file)
    if not {"x", "y"} <= set(column):
        raise DemonstrationError(f"{file} has the columns {list(column)}, expected x and y among them.")
    return np.stack([column["x"], column["y"]], axis=1)


def _of_mat(file: Path) -> dict[str, np.ndarray]:
    with importing("scipy", "formats"):
        from scipy.io import loadmat
    try:
        content = loadmat(file, simplify_cells=True)
    except (OSError, ValueError, NotImplementedError, TypeError) as error:
        raise DemonstrationError(f"{file} is not readable as a MAT file of version 7.2 or earlier: {error}.") from error
    return dict(_positions({k: v for k, v in content.items() if k[:2] != "__"}, ""))


def _positions(entry: Any, where: str) -> list[tuple[str, np.ndarray]]:
    """What is named as positions in structures within structures."""
    if isinstance(entry, dict):
        named = [(f"{where}.{key}", entry[key]) for key in _NAMES if isinstance(entry.get(key), np.ndarray)]
        return named or [found for key, value in entry.items() for found in _positions(value, f"{where}.{key}")]
    if isinstance(entry, list) or (isinstance(entry, np.ndarray) and entry.dtype == object):
        return [found for k, value in enumerate(entry) for found in _positions(value, f"{where}[{k}]")]
    return []


def _as_path(array: np.ndarray, where: str) -> np.ndarray:
    try:
        path = np.array(array, np.float64)
    except (TypeError, ValueError) as error:
        raise DemonstrationError(f"{where} is not an array of numbers: {error}.") from error
    if path.ndim == 2 and path.shape[0] == 2 != path.shape[1]:
        path = path.T
    if path.ndim != 2 or path.shape[1] != 2 or len(path) < 2:
        raise DemonstrationError(f"{where} has shape {path.shape}, expected [T, 2], a path in the plane.")
    if (bad := np.flatnonzero(~np.isfinite(path).all(axis=1))).size:
        raise DemonstrationError(f"{where} is not finite at sample {bad[0]}.")
    return path
