"""Depth images in a file, with what is known of their camera and of the robot before it: read one by one."""

import dataclasses
import os
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import FramesError, JaxrmpError
from .._task_map import check_rigid
from ._camera import Camera

_FARTHEST = 50.0  # m, beyond which the middle of what is seen says that the unit is another
_NEAREST = 0.01


@dataclasses.dataclass(frozen=True)
class DepthFrames:
    """T depth images of a camera that stands still, as `open_frames` finds them.

    `path`, of their file; `camera`, at its `T_world_camera`, or at the origin where `posed` is false and no pose is
    known; `time` [T], s; `q` [T, n], the joints of the robot at each, rad or m, or None; `depth_scale`, m for one of
    what the file holds; `dtype` of that.
    """

    path: Path
    camera: Camera
    posed: bool
    time: np.ndarray
    q: np.ndarray | None
    depth_scale: float
    dtype: np.dtype

    def __len__(self) -> int:
        return len(self.time)

    def depths(self) -> Iterator[np.ndarray]:
        """The images [height, width] in turn, m, in single precision, 0 where nothing was measured. One at a time is
        in memory. **Raises** `FramesError` for a damaged file, or depths that are in another unit."""
        checked = False  # by the first image that shows anything: cameras begin with empty ones
        for raw in self.raw():
            depth = raw.astype(np.float32) * np.float32(self.depth_scale)
            depth[~np.isfinite(depth) | (depth <= 0)] = 0
            if not checked and (depth > 0).any():
                self._check_unit(depth)
                checked = True
            yield depth

    def raw(self) -> Iterator[np.ndarray]:
        """The images [height, width] in turn, as the file has them."""
        shape = self.camera.height, self.camera.width
        size = self.dtype.itemsize * shape[0] * shape[1]
        try:
            with zipfile.ZipFile(self.path) as archive, archive.open("depth.npy") as file:
                _header(file)
                for _ in range(len(self)):
                    content = file.read(size)
                    if len(content) != size:
                        raise FramesError(f"{self.path}: depth ends before its {len(self)} images.")
                    yield np.frombuffer(content, self.dtype).reshape(shape)
        except (OSError, EOFError, zipfile.BadZipFile, zlib.error) as error:
            raise FramesError(f"{self.path} cannot be read: {error}") from error

    def _check_unit(self, depth: np.ndarray) -> None:
        if not _NEAREST < (middle := float(np.median(depth[depth > 0]))) < _FARTHEST:
            said = "give integers with their depth_scale" if self.dtype.kind == "f" else "check depth_scale"
            raise FramesError(
                f"{self.path}: what the first image with depths shows is {middle:.4g} m away, half of it farther. "
                f"Depths are in m: {said}, 0.001 for millimetres."
            )


def open_frames(path: str | os.PathLike) -> DepthFrames:
    """The depth images of the NPZ file at `path`, which are read as they are asked for.

    It holds `depth` [T, height, width], along the camera's axis: floats in m, or unsigned integers times `depth_scale`,
    m; not positive or not finite where nothing was measured. `intrinsics` [4], fx, fy, cx and cy, pixels, of pictures
    without distortion; `time` [T], s, rising. It may hold `T_world_camera` [4, 4], and `q` [T, n], a robot's joints.
    **Raises** `FramesError` for what is missing or makes no sense, saying what.
    """
    path = Path(path)
    try:
        with zipfile.ZipFile(path) as archive:
            held = {Path(name).stem for name in archive.namelist()}
            for name in ("depth", "intrinsics", "time"):
                if name not in held:
                    raise FramesError(f"{path} has no {name!r}, and {sorted(held)}. {_LAYOUT}")
            with archive.open("depth.npy") as file:
                shape, dtype = _header(file)
        with np.load(path, allow_pickle=False) as content:
            small = {name: np.asarray(content[name]) for name in held - {"depth"} if name in _KNOWN}
    except FramesError as error:
        raise error if str(path) in str(error) else FramesError(f"{path}: {error}") from None
    except FileNotFoundError as error:
        raise FramesError(f"{path} is not there.") from error
    except Exception as error:  # zipfile, zlib and NumPy have many kinds of errors for damaged bytes
        raise FramesError(f"{path} cannot be read as NPZ: {type(error).__name__}: {error}") from error
    if len(shape) != 3 or not min(shape):
        raise FramesError(f"{path}: depth has shape {shape}, expected [T, height, width], none of them 0.")
    for name in small:
        if small[name].dtype.kind not in "fiu":
            raise FramesError(f"{path}: {name} is of type {small[name].dtype}, expected numbers.")
        if not np.isfinite(small[name]).all():
            raise FramesError(f"{path}: {name} holds what is not finite.")
    count = shape[0]
    _expect(path, "time", small["time"], (count,), "seconds of each image")
    backwards = np.flatnonzero(np.diff(small["time"]) <= 0)
    if len(backwards):
        k = int(backwards[0])
        raise FramesError(
            f"{path}: time does not rise from image {k} ({small['time'][k]} s) to {k + 1} ({small['time'][k + 1]} s)."
        )
    q = small.get("q")
    if q is not None and (q.ndim != 2 or len(q) != count):
        raise FramesError(f"{path}: q has shape {q.shape}, expected ({count}, n): the robot's joints at each image.")
    posed = "T_world_camera" in small
    camera = camera_of(path, small["intrinsics"], small.get("T_world_camera"), shape[2], shape[1])
    scale = _scale(path, dtype, small.get("depth_scale"))
    joints = None if q is None else q.astype(float)
    return DepthFrames(path, camera, posed, small["time"].astype(float), joints, scale, dtype)


def camera_of(path: Path, intrinsics: np.ndarray, T: np.ndarray | None, width: int, height: int) -> Camera:
    """The camera of the frames at `path`. **Raises** `FramesError` for numbers that are none of a camera."""
    _expect(path, "intrinsics", intrinsics, (4,), "fx, fy, cx, cy, pixels")
    fx, fy, cx, cy = intrinsics.astype(float)
    if T is not None:
        _expect(path, "T_world_camera", T, (4, 4), "the camera's pose, m")
    try:
        T = None if T is None else check_rigid(np.asarray(T, float), "T_world_camera")
        return Camera(np.array([fx, fy]), np.array([cx, cy]), T, width, height)
    except JaxrmpError as error:
        raise FramesError(f"{path}: {error}") from error


_KNOWN = ("intrinsics", "time", "T_world_camera", "q", "depth_scale")
_LAYOUT = (
    "Frames are depth [T, height, width], intrinsics [fx, fy, cx, cy], time [T], and, of integers, depth_scale; "
    "T_world_camera [4, 4] and q [T, n] if known."
)


def _scale(path: Path, dtype: np.dtype, given: np.ndarray | None) -> float:
    if dtype.kind == "f":
        if given is not None and (given.shape != () or given != 1):
            raise FramesError(f"{path}: depth_scale is {given}, and depth holds floats, which are in m: leave it out.")
        return 1.0
    if dtype.kind != "u":
        raise FramesError(f"{path}: depth is of type {dtype}, expected floats, m, or unsigned integers.")
    if given is None:
        raise FramesError(
            f"{path}: depth holds integers, and there is no depth_scale, m for one of them: 0.001 for millimetres."
        )
    if given.shape != () or not given > 0:
        raise FramesError(f"{path}: depth_scale is {given}, expected a positive number, m.")
    return float(given)


def _expect(path: Path, name: str, value: np.ndarray, shape: tuple, what: str) -> None:
    if value.shape != shape:
        raise FramesError(f"{path}: {name} has shape {value.shape}, expected {shape}: {what}.")


def _header(file: Any) -> tuple[tuple[int, ...], np.dtype]:
    """Shape and type of the array of an open NPY file, which goes on with the numbers."""
    version = np.lib.format.read_magic(file)
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}.get(version)
    if read is None:
        raise FramesError(f"depth is an NPY file of version {version}, expected 1.0 or 2.0.")
    shape, fortran, dtype = read(file)
    if fortran and len(shape) > 1:
        raise FramesError("depth is stored column by column: write numpy.ascontiguousarray(depth).")
    return shape, dtype
