"""Videos and snapshots of trials, by MuJoCo's offscreen renderer."""

import contextlib
import ctypes.util
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import ConfigurationError, importing
from .._files import atomic_write
from ..kinematics._mujoco import import_mujoco
from ..scenes import picture_model
from ..simulation import Run
from ._framing import framing

_SIZE = 720, 1280
_SNAPSHOT = 640, 800  # of that, the middle; shown at half that size, so that edges are smooth
_COLUMNS = 3  # that many side by side are as wide as the figures
_LOOKED = 12  # states of a trial that the camera is to hold
_PER_SECOND = 25  # every second sample of a trace
_ENCODING = {
    ".mp4": ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-movflags", "+faststart"],
    ".gif": ["-vf", "split[a][b];[a]palettegen[p];[b][p]paletteuse"],
}


def prepare_headless() -> None:
    """Choose how MuJoCo draws without a display; to be called before mujoco is imported first.

    `MUJOCO_GL`, if set, is left alone. **Raises** `ConfigurationError` if there is neither a display nor OSMesa.
    """
    if os.environ.get("MUJOCO_GL") or sys.platform != "linux" or os.environ.get("DISPLAY"):
        return
    if ctypes.util.find_library("OSMesa") is None:
        raise ConfigurationError(
            "drawing without a display needs OSMesa: apt-get install -y --no-install-recommends libosmesa6 (as root), "
            "or set MUJOCO_GL=egl where EGL works."
        )
    os.environ["MUJOCO_GL"] = "osmesa"


def check_video_name(path: str | os.PathLike) -> None:
    """**Raises** `ConfigurationError` for a `path` whose ending is that of no video we can write."""
    if Path(path).suffix not in _ENCODING:
        raise ConfigurationError(f"video {str(path)!r}: expected a name that ends in .mp4 or .gif.")


def save_video(run: Run, path: str | os.PathLike, trials: int = 3) -> Path:
    """Write the first `trials` of `run`, one after the other, in real time, as MP4 or GIF by the ending of `path`.

    **Raises** `ConfigurationError` for another ending or where MuJoCo cannot draw; `MissingDependencyError` without
    imageio-ffmpeg.
    """
    path = Path(path)
    check_video_name(path)
    with importing("imageio-ffmpeg", "simulation"):
        from imageio_ffmpeg import get_ffmpeg_exe
    run, count = _pictured(run), min(trials, len(run.trials))
    height, width = _SIZE
    camera = _camera(run, range(count), _SIZE)
    command = [get_ffmpeg_exe(), "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{width}x{height}", "-r", str(_PER_SECOND), "-i", "-", *_ENCODING[path.suffix]]
    with atomic_write(path) as file, tempfile.TemporaryDirectory() as folder, _renderer(run.scene.model) as renderer:
        encoded, said = Path(folder) / path.name, Path(folder) / "said"
        with said.open("wb") as errors:
            encoder = subprocess.Popen([*command, str(encoded)], stdin=subprocess.PIPE, stderr=errors)
            with contextlib.suppress(BrokenPipeError), encoder:  # where it ends early, it says why
                for k in range(count):
                    for t in range(0, len(run.traces[k].time), 2):
                        encoder.stdin.write(_frame(renderer, camera, run, k, t).tobytes())  # type: ignore[union-attr]
        if encoder.returncode:
            raise ConfigurationError(f"ffmpeg could not write {str(path)!r}: {said.read_text().strip()}")
        file.write(encoded.read_bytes())
    return path


def snapshots(run: Run, trial: int = 0, count: int = 6) -> np.ndarray:
    """Pictures of trial `trial` of `run` at `count` instants even in time, three side by side: [height, width, 3].

    As wide as the figures; rows follow one another, and the last is filled up in white.

    Rana et al. 2019, figures 3, 5, 7 and 8. **Raises** `ConfigurationError` where MuJoCo cannot draw.
    """
    instants = np.linspace(0, len(run.traces[trial].time) - 1, count).round().astype(int)
    run = _pictured(run, smooth=True)
    camera = _camera(run, [trial], _SNAPSHOT)
    with _renderer(run.scene.model) as renderer:
        frames = [_frame(renderer, camera, run, trial, int(t)) for t in instants]
    rows, columns = (
        slice((whole - part) // 2, (whole + part) // 2) for whole, part in zip(_SIZE, _SNAPSHOT, strict=True)
    )
    halves = (_SNAPSHOT[0] // 2, 2, _SNAPSHOT[1] // 2, 2, 3)
    small = [frame[rows, columns].reshape(halves).mean((1, 3)).round().astype(np.uint8) for frame in frames]
    small += [np.full_like(small[0], 255)] * (-count % _COLUMNS)
    across = [np.concatenate(small[k : k + _COLUMNS], axis=1) for k in range(0, len(small), _COLUMNS)]
    return np.concatenate(across, axis=0)


def _pictured(run: Run, smooth: bool = False) -> Run:
    """The same run in the model that is drawn."""
    return run._replace(scene=replace(run.scene, model=picture_model(run.scene, smooth=smooth)))


def _camera(run: Run, trials: Iterable[int], part: tuple[int, int]) -> Any:
    """A camera that holds `trials` of a run in the middle `part` of the picture, pixels."""
    states = []
    for k in trials:
        steps = np.linspace(0, len(run.traces[k].time) - 1, _LOOKED).round().astype(int)
        states += [_state(run, k, int(t)) for t in steps]
    return framing(run.scene.model, states, (part[0] / _SIZE[0], part[1] / _SIZE[0]))


def _renderer(model: Any) -> Any:
    mujoco = import_mujoco()
    try:
        return mujoco.Renderer(model, *_SIZE)
    except Exception as error:  # whatever the graphics library raises
        raise ConfigurationError(
            f"MuJoCo cannot draw here ({error}). Without a display: apt-get install -y --no-install-recommends "
            "libosmesa6 (as root) and MUJOCO_GL=osmesa."
        ) from error


def _state(run: Run, trial: int, t: int) -> Any:
    """A `mujoco.MjData` of a trial at its sample `t`."""
    mujoco = import_mujoco()
    scene, trace = run.scene.at(run.trials[trial]), run.traces[trial]
    data = scene.fresh()
    data.qpos[:] = trace.qpos[t]
    scene.move_object(data, trace.T_world_object[t])
    scene.moving_obstacles(data, float(trace.time[t]))
    mujoco.mj_kinematics(scene.model, data)
    mujoco.mj_camlight(scene.model, data)
    return data


def _frame(renderer: Any, camera: Any, run: Run, trial: int, t: int) -> np.ndarray:
    renderer.update_scene(_state(run, trial, t), camera=camera)
    return renderer.render().copy()
