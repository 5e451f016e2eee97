"""`jaxrmp view --robot FILE` as a person runs it: the page of an arm of one's own, until Ctrl-C."""

import io
import re
import signal
import subprocess
import sys
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from .conftest import Page

SIX_AXIS = Path(__file__).parents[1] / "kinematics" / "models" / "six_axis.urdf"


@pytest.fixture
def command():
    pytest.importorskip("viser", reason="needs viser: pip install 'jaxrmp[viewer]'")
    line = [sys.executable, "-m", "jaxrmp", "view", "--robot", str(SIX_AXIS), "--port", "0"]
    process = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    yield process
    process.kill()
    process.communicate()


def test_an_arm_of_ones_own_follows_its_goal_until_ctrl_c(command, chromium, tmp_path):
    from jaxrmp.viewer import reach_content

    said = iter(command.stdout.readline, "")
    url = next(found[0] for line in said if (found := re.search(r"http://127\.0\.0\.1:\d+", line)))
    page = Page(chromium, url)
    before = pixels(page.picture(tmp_path / "before.png"))
    goal = reach_content(str(SIX_AXIS)).T_world_target.copy()
    goal[:3, 3] += [-0.2, 0.3, -0.2]
    page.drag("/target", goal)

    def arm_has_moved() -> bool:
        change = np.abs(pixels(page.picture(tmp_path / "after.png")) - before).max(-1)
        return (change > 0.2).mean() > 0.003

    page.wait(arm_has_moved, "the arm to move on the page", 60)
    assert page.errors == []
    page.close()
    command.send_signal(signal.SIGINT)
    _, errors = command.communicate(timeout=60)
    assert command.returncode == 0
    assert "Traceback" not in errors


def pixels(png: bytes) -> np.ndarray:
    """The middle of a picture of the page, without its panels and what it tells: colours [height, width, 3], 0 to 1."""
    picture = matplotlib.image.imread(io.BytesIO(png))[..., :3]
    height, width = picture.shape[:2]
    return picture[2 * height // 5 :, 2 * width // 5 : 2 * width // 3]
