"""`jaxrmp view --robot FILE` as a person runs it: the page of an arm of one's own, until Ctrl-C."""

import io
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from .conftest import Page

SIX_AXIS = Path(__file__).parents[1] / "kinematics" / "models" / "six_axis.urdf"


@pytest.fixture
def command(tmp_path):
    """The command's process and the file of all that it says."""
    pytest.importorskip("viser", reason="needs viser: pip install 'jaxrmp[viewer]'")
    line = [sys.executable, "-m", "jaxrmp", "view", "--robot", str(SIX_AXIS), "--port", "0"]
    said = tmp_path / "said.txt"
    with said.open("w") as file:
        process = subprocess.Popen(line, stdout=file, stderr=file)
        yield process, said
        process.kill()
        process.wait()


def test_an_arm_of_ones_own_follows_its_goal_until_ctrl_c(command, chromium, tmp_path):
    from jaxrmp.viewer import reach_content

    process, said = command
    page = Page(chromium, address(process, said))
    try:
        page.page.set_viewport_size({"width": 1600, "height": 640})  # wide enough for the arm beside the panels
        seen = [pixels(page, tmp_path / "before.png")]

        def still() -> bool:
            seen.append(pixels(page, tmp_path / "before.png"))
            return changed(*seen[-2:]) == 0 and seen[-1].std() > 0.01

        page.wait(still, "the arm to be drawn", 120)
        goal = reach_content(str(SIX_AXIS)).T_world_target.copy()
        goal[:3, 3] += [-0.2, 0.3, -0.2]
        page.drag("/target", goal)
        page.wait(lambda: changed(pixels(page, tmp_path / "after.png"), seen[-1]) > 0.003, "the arm to move", 120)
        assert page.errors == []
    finally:
        page.close()
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=60) == 0
    assert "Traceback" not in said.read_text()


def address(process: subprocess.Popen, said: Path) -> str:
    """Where the page is, once the command says so."""
    end = time.monotonic() + 180
    while not (found := re.search(r"The page is at (http://127\.0\.0\.1:\d+)", said.read_text())):
        assert process.poll() is None and time.monotonic() < end, said.read_text()
        time.sleep(0.2)
    return found[1]


def pixels(page: Page, file: Path) -> np.ndarray:
    """The middle of a picture of the page, without its panels and what it tells: colours [height, width, 3], 0 to 1."""
    picture = matplotlib.image.imread(io.BytesIO(page.picture(file)))[..., :3]
    height, width = picture.shape[:2]
    return picture[height // 3 :, width // 4 : 3 * width // 4]


def changed(a: np.ndarray, b: np.ndarray) -> float:
    """The share of pixels that two pictures differ in."""
    return float((np.abs(a - b).max(-1) > 0.2).mean())
