"""`jaxrmp view --robot FILE` of arms of other people, as a person uses it: started with nothing compiled or covered,
opened in Chromium, its goal dragged, a ball put into the way, and pushed at the hand.

Robots as in `robots`: `make robots`, or JAXRMP_ROBOTS. All that is measured comes from the page: the places of the
links as it was told them, and what it complained of. Distances are those of the spheres that cover the robot, from
their poses on the page, in every update, to the ball that is drawn. Goals are such that `find_posture` has a posture
for them, clear of the arm itself and of the ball. Pictures lie in out/benchmarks/view.
"""

import contextlib
import re
import signal
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxrmp._rotations import rotation_of_vector
from jaxrmp.kinematics import idle_joints, load_robot
from jaxrmp.viewer import reach_content

from ._page import Page, launch, served
from ._report import FOLDER
from .robots import FOLDER as FILES
from .robots import of_each

PICTURES = FOLDER / "view"
SIZE = {"width": 1500, "height": 900}
STEP, BALL = 0.15, 0.06  # m: a drag of the goal, and the ball's radius
NEAR, PATIENCE = 0.01, 12.0  # m, s: what counts as there, and how long is waited for it, in simulated time


class Arm(NamedTuple):
    """A file of the package, the frame that is the hand, and how far a drag past the ball goes, m."""

    file: str
    hand: str
    aside: float = 0.3


ROBOTS = {
    "UR10": Arm("ur_description/urdf/ur10_robot.urdf", "tool0"),
    "xArm7": Arm("xarm_description/urdf/xarm7.urdf", "link_eef"),
    "SO-101": Arm("so_arm_description/urdf/so101.urdf", "gripper_frame_link"),
    "Tiago Dual": Arm("tiago_description/robots/tiago_dual.urdf", "hand_right_grasping_frame", 0.5),
}


class Drive:
    """A page whose arm has a frame `hand`, spheres and a ball; `least`, how near the ball came to a sphere, m."""

    def __init__(self, page: Page, hand: str, spheres: Any):
        self.page, self.least = page, np.inf
        self._hand, self._frames = f"/arm/{hand}", [f"/arm/{name}" for name in spheres.frames]
        self._offsets, self._radii = np.asarray(spheres.offsets, float), np.asarray(spheres.radii, float)
        page.on_frame = self._watch

    def _watch(self) -> None:
        T = np.stack([self.page.nodes[name] for name in self._frames])
        centers = np.einsum("kij,kj->ki", T[:, :3, :3], self._offsets) + T[:, :3, 3]
        distances = np.linalg.norm(centers - self.page.nodes["/solid_1"][:3, 3], axis=1) - self._radii - BALL
        self.least = min(self.least, float(distances.min()))

    def place(self, name: str) -> np.ndarray:
        """Where the page has a node, [3]."""
        return self.page.nodes[name][:3, 3].copy()

    def goal_at(self, position: np.ndarray) -> tuple[float, float]:
        """Drag the goal there, turned as it is: how far the hand is from it in the end, m, and after how long, s."""
        self._drag("/target", position)
        begun = time.monotonic()
        while (time.monotonic() - begun) * self.pace < PATIENCE and self.away > 0.5 * NEAR:
            self.page.page.wait_for_timeout(50)
        return self.away, (time.monotonic() - begun) * self.pace

    @property
    def pace(self) -> float:
        """Simulated seconds a second, as the page tells them: below 1 where the machine is slow."""
        told = re.search(r"×([\d.]+)", self.page.page.get_by_text("updates/s").inner_text())
        return min(max(float(told[1]), 0.1), 1.0) if told else 1.0

    @property
    def away(self) -> float:
        """How far the hand is from its goal, m."""
        return float(np.linalg.norm(self.place(self._hand) - self._goal))

    def ball_to(self, position: np.ndarray, speed: float) -> None:
        """Drag the ball along a line."""
        start, speed = self.place("/obstacle_1"), speed * self.pace
        steps = max(int(np.linalg.norm(position - start) / (0.05 * speed)), 1)
        poses = np.tile(np.eye(4), (steps, 1, 1))
        poses[:, :3, 3] = start + np.linspace(0, 1, steps + 1)[1:, None] * (position - start)
        for T in poses:
            self._drag("/obstacle_1", T[:3, 3])
            self.page.page.wait_for_timeout(50)
        with contextlib.suppress(AssertionError):
            self.page.wait(lambda: np.linalg.norm(self.place("/solid_1") - position) < 1e-3, "the ball", 20)

    def _drag(self, name: str, position: np.ndarray) -> None:
        T = self.page.nodes[name].copy()
        T[:3, 3] = position
        self.page.drag(name, T)
        self.page.nodes[name] = T
        if name == "/target":
            self._goal = position


def row(name: str, arm: Arm) -> dict[str, Any]:
    """One robot, from its command to its end."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    robot = load_robot(FILES / arm.file)
    robot = load_robot(FILES / arm.file, fixed=dict.fromkeys(idle_joints(robot)))
    spheres = reach_content(robot, arm.hand).policy.spheres  # before, not to take the page's time
    with tempfile.TemporaryDirectory() as cold:
        caches = {"JAX_COMPILATION_CACHE_DIR": f"{cold}/compiled", "JAXRMP_CACHE": f"{cold}/covers"}
        said = Path(cold, "said.txt")
        begun = time.monotonic()
        with served(("--robot", str(FILES / arm.file)), caches, said) as view:
            result: dict[str, Any] = {"name": name, "command_s": time.monotonic() - begun, "hand": view.hand}
            with launch() as browser:
                page = Page(browser, view.url, SIZE)
                result["page_s"] = time.monotonic() - begun
                result |= driven(name, page, arm, Drive(page, view.hand, spheres))
                result["page_errors"] = len(page.errors)
                page.close()
            view.process.send_signal(signal.SIGINT)
            result["exit"] = view.process.wait(timeout=60)
            result["traceback"] = "Traceback" in said.read_text()
    good = result["hand"] == arm.hand and result["colours"] > 0 and result["least_mm"] > 0
    good = good and max(result["drag_mm"], result["past_ball_mm"]) < 1e3 * NEAR
    good = good and not (result["page_errors"] or result["exit"] or result["traceback"])
    return result | {"verdict": "met" if good else "MISSED"}


def driven(name: str, page: Page, arm: Arm, drive: Drive) -> dict[str, Any]:
    """What becomes of three drags of the goal and two of the ball."""
    page.page.wait_for_timeout(2000)
    page.picture(PICTURES / f"{name}_start.png")
    at = drive.place("/target")
    inward = -at * [1, 1, 0] / np.linalg.norm(at[:2])
    away, seconds = drive.goal_at(at + STEP * inward)
    start = drive.place("/target")
    turn = (
        2 * np.arcsin(0.5 * arm.aside / np.linalg.norm(start[:2])) * (-1 if start[1] < -0.1 else 1)
    )  # away from the body
    beyond = rotation_of_vector(turn * np.array([0.0, 0.0, 1.0])) @ start
    middle = 0.5 * (start + beyond)
    above = [0, 0, 0.4]
    drive.ball_to(middle + above, 1.0)
    drive.least = np.inf
    drive.ball_to(middle, 0.2)
    past, past_seconds = drive.goal_at(beyond)
    page.picture(PICTURES / f"{name}_ball.png")
    beside = drive.least
    drive.ball_to(middle + above, 0.5)
    drive.ball_to(beyond + above, 0.5)
    drive.ball_to(beyond, 0.1)
    page.page.wait_for_timeout(2000)
    page.picture(PICTURES / f"{name}_pushed.png")
    return {
        "shapes": len(page.colours),
        "colours": len(set(page.colours.values())),
        "pace": drive.pace,
        "drag_mm": 1e3 * away,
        "drag_s": seconds,
        "past_ball_mm": 1e3 * past,
        "past_ball_s": past_seconds,
        "beside_mm": 1e3 * beside,
        "least_mm": 1e3 * drive.least,
        "pushed_away_mm": 1e3 * drive.away,
    }


def rows() -> list[dict[str, Any]]:
    """One row a robot."""
    return of_each(ROBOTS, row)
