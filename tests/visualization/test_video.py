"""Videos: frames go to the encoder as they are drawn."""

import subprocess
import weakref
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from jaxrmp import ConfigurationError
from jaxrmp.visualization import _video, save_video, snapshots
from jaxrmp.visualization._style import DPI, WIDTH

SAMPLES = 80
RUN = SimpleNamespace(
    scene=SimpleNamespace(model=None), trials=[None] * 3, traces=[SimpleNamespace(time=np.arange(SAMPLES))] * 3
)


@pytest.fixture
def drawn(monkeypatch):
    """Grey pictures instead of MuJoCo's, the brighter the later; filled with how many were kept as each was drawn."""
    pictures, kept = [], []

    def frame(renderer, camera, run, trial, t):
        kept.append(sum(picture() is not None for picture in pictures))
        picture = np.full((*_video._SIZE, 3), 40 * trial + t, np.uint8)
        pictures.append(weakref.ref(picture))
        return picture

    monkeypatch.setattr(_video, "_renderer", lambda model: nullcontext())
    monkeypatch.setattr(_video, "_pictured", lambda run, smooth=False: run)
    monkeypatch.setattr(_video, "_camera", lambda run, trials, part: None)
    monkeypatch.setattr(_video, "_frame", frame)
    return kept


@pytest.mark.parametrize("ending", ["mp4", "gif"])
def test_every_second_sample_of_every_trial_is_in_the_video_and_none_is_kept(drawn, tmp_path, ending):
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    path = save_video(RUN, tmp_path / f"run.{ending}", trials=2)
    assert len(drawn) == SAMPLES and max(drawn) <= 1
    command = [ffmpeg, "-loglevel", "error", "-i", str(path), "-f", "rawvideo", "-pix_fmt", "gray", "-"]
    raw = subprocess.run(command, check=True, capture_output=True, timeout=60).stdout
    seen = np.frombuffer(raw, np.uint8).reshape(-1, *_video._SIZE).mean((1, 2))
    expected = np.concatenate([40 * k + np.arange(0, SAMPLES, 2) for k in range(2)])
    np.testing.assert_allclose(seen, expected, atol=8)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_what_the_encoder_says_is_passed_on_even_if_it_ends_early(drawn, tmp_path, monkeypatch):
    pytest.importorskip("imageio_ffmpeg")
    monkeypatch.setitem(_video._ENCODING, ".mp4", ["-c:v", "no_such_codec"])
    with pytest.raises(ConfigurationError, match=r"ffmpeg could not write .*run\.mp4.*no_such_codec"):
        save_video(RUN, tmp_path / "run.mp4")
    assert not list(tmp_path.iterdir())


def test_where_drawing_fails_nothing_is_left(drawn, tmp_path, monkeypatch):
    pytest.importorskip("imageio_ffmpeg")
    monkeypatch.setattr(_video, "_frame", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        save_video(RUN, tmp_path / "run.mp4")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("count", "rows"), [(6, 2), (4, 2), (1, 1)])
def test_snapshots_are_as_wide_as_figures_and_in_the_order_of_time(drawn, count, rows):
    picture = snapshots(RUN, count=count)
    height, width, _ = picture.shape
    assert width == WIDTH * DPI and height == rows * 320
    instants = np.linspace(0, SAMPLES - 1, count).round()
    shown = picture.reshape(rows, height // rows, 3, width // 3, 3).mean((1, 3, 4)).ravel()
    np.testing.assert_array_equal(shown, [*instants, *[255] * (3 * rows - count)])
