"""Files: written so that a reader never sees half of one, and read so that a damaged one is an error of one kind."""

import contextlib
import os
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ._unfinished import temporary_file


@contextlib.contextmanager
def atomic_write(path: str | os.PathLike) -> Iterator[BinaryIO]:
    """Open a binary file that takes the place of `path` when the block ends, and vanishes if the block fails.

    **Raises** `OSError`, which names `path`, where no file can be made.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with temporary_file(path) as (handle, temporary):
        with os.fdopen(handle, "wb") as file:
            yield file
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, 0o666 & ~umask)
        os.replace(temporary, path)


def read_npz(path: str | os.PathLike) -> dict[str, np.ndarray]:
    """All arrays of an NPZ file, without unpickling anything.

    **Raises** `FileNotFoundError`, and `ValueError` for whatever else is wrong with the file: zipfile, zlib and NumPy
    have many kinds of errors for damaged bytes.
    """
    with _npz(path) as archive:
        return {name: archive[name] for name in archive.files}


def names_in_npz(path: str | os.PathLike) -> list[str]:
    """The names of the arrays of an NPZ file, which are not read. **Raises** as `read_npz`."""
    with _npz(path) as archive:
        return list(archive.files)


@contextlib.contextmanager
def _npz(path: str | os.PathLike) -> Iterator[Any]:
    try:
        if not zipfile.is_zipfile(path) and Path(path).is_file():
            raise ValueError("it is no NPZ archive, or its end is missing")
        with np.load(path, allow_pickle=False) as archive:
            yield archive
    except (FileNotFoundError, ValueError):
        raise
    except Exception as error:
        raise ValueError(f"{type(error).__name__}: {error}") from error
