"""Depth images written to a file as they come."""

import contextlib
import io
import math
import os
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from .._errors import FramesError
from .._files import atomic_write
from ._frames import camera_of


class AddFrame(Protocol):
    """What takes one image more."""

    def __call__(self, depth: Any, time: float, q: Any = None) -> None:
        """`depth` [height, width], m, or unsigned integers; `time`, s; `q` [n], the robot's joints then."""
        ...


@contextlib.contextmanager
def frames_writer(
    path: str | os.PathLike, intrinsics: Any, *, T_world_camera: Any = None, depth_scale: float | None = None
) -> Iterator[AddFrame]:
    """Within it, a function `add(depth, time, q=None)` of each image; at its end the file is there, for `open_frames`.

    Images wait on disk beside it, not in memory, so that a minute of them does not need 2 GB. Where the block fails, or
    is interrupted by Ctrl-C, the file holds the images before that, and the error goes on.

    **Arguments**: `path`, of an NPZ file; `intrinsics`, fx, fy, cx and cy, pixels; `T_world_camera` [4, 4], m, if
    known; `depth_scale`, m for one of the images' unsigned integers, none for floats, m.
    **Raises** `FramesError`, at once for intrinsics, a pose or a scale that make no sense; for an image unlike the
    first, or a time that does not rise, or no image at all.
    """
    path = Path(path)
    intrinsics = np.asarray(intrinsics, float)
    pose = None if T_world_camera is None else np.asarray(T_world_camera, float)
    if not np.isfinite(intrinsics).all():
        raise FramesError(f"{path}: intrinsics are {intrinsics}, expected finite numbers.")
    camera_of(path, intrinsics, pose, 1, 1)
    if depth_scale is not None and not 0 < depth_scale < np.inf:
        raise FramesError(f"{path}: depth_scale is {depth_scale}, expected a positive number, m.")
    path.parent.mkdir(parents=True, exist_ok=True)
    times: list[float] = []
    joints: list[np.ndarray] = []
    kind: list[tuple[tuple[int, ...], np.dtype]] = []
    with tempfile.TemporaryFile(dir=path.parent) as images:

        def add(depth: Any, time: float, q: Any = None) -> None:
            depth = np.asarray(depth)
            depth = depth.astype(np.float32) if depth.dtype.kind == "f" else depth
            if not kind:
                if depth.ndim != 2 or depth.dtype.kind not in "fu" or not depth.size:
                    raise FramesError(
                        f"an image of shape {depth.shape} and type {depth.dtype}, expected [height, width] of floats, "
                        "m, or unsigned integers."
                    )
                if (depth_scale is None) != (depth.dtype.kind == "f"):
                    raise FramesError(
                        f"an image of type {depth.dtype} and a depth_scale of {depth_scale}: give one for integers, m "
                        "for one of them, and none for floats."
                    )
                kind.append((depth.shape, depth.dtype))
            if (depth.shape, depth.dtype) != kind[0]:
                raise FramesError(f"an image of {depth.shape} {depth.dtype} after those of {kind[0][0]} {kind[0][1]}.")
            if not np.isfinite(time) or (times and not time > times[-1]):
                raise FramesError(f"image {len(times)} is of {time} s, after {times[-1] if times else 'none'}.")
            if bool(joints) != (q is not None) and times:
                raise FramesError("q is given of some images and not of others: give it of all, or of none.")
            if q is not None:
                q = np.array(q, float)
                if not np.isfinite(q).all() or q.ndim != 1 or (joints and q.shape != joints[0].shape):
                    raise FramesError(f"q of image {len(times)} is {q}, expected as many finite numbers as before.")
            images.seek(len(times) * depth.nbytes)  # over what an interrupted image left
            images.write(np.ascontiguousarray(depth).tobytes())
            joints[len(times) :] = [] if q is None else [q]
            times.append(float(time))

        failed = True
        try:
            yield add
            failed = False
        finally:
            if times:
                _write(path, intrinsics, pose, depth_scale, times, joints, kind[0], images)
            elif not failed:
                raise FramesError(f"{path}: no image was added.")


def _write(
    path: Path,
    intrinsics: np.ndarray,
    pose: np.ndarray | None,
    depth_scale: float | None,
    times: list[float],
    joints: list[np.ndarray],
    kind: tuple[tuple[int, ...], np.dtype],
    images: Any,
) -> None:
    arrays: dict[str, Any] = {"intrinsics": intrinsics, "time": np.array(times)}
    arrays |= {} if depth_scale is None else {"depth_scale": np.array(depth_scale)}
    arrays |= {} if pose is None else {"T_world_camera": pose}
    arrays |= {"q": np.stack(joints[: len(times)])} if joints else {}
    images.seek(0)
    with atomic_write(path) as file, zipfile.ZipFile(file, "w") as archive:
        for name, value in arrays.items():
            content = io.BytesIO()
            np.lib.format.write_array(content, value, allow_pickle=False)
            archive.writestr(f"{name}.npy", content.getvalue())
        with archive.open("depth.npy", "w", force_zip64=True) as member:
            np.lib.format.write_array_header_1_0(
                member,
                {
                    "descr": np.lib.format.dtype_to_descr(kind[1]),
                    "fortran_order": False,
                    "shape": (len(times), *kind[0]),
                },
            )
            for _ in times:
                member.write(images.read(kind[1].itemsize * math.prod(kind[0])))
