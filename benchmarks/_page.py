"""A real, headless Chromium, and pages of ours in it, used as a person uses them: by the tests of the viewer too."""

import contextlib
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxrmp._rotations import quaternion_of_rotation, rotation_of_quaternion

ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--enable-unsafe-swiftshader",
]
SIZE = {"width": 1000, "height": 620}

# viser's page hands what it sends to a worker that has the websocket. Kept here, so that a test can hand it the same.
# And it draws twice a second at most: in software, on cores that other tests need, pictures are most of the time.
PREPARE = """
const draw = window.requestAnimationFrame.bind(window);
window.requestAnimationFrame = f => setTimeout(() => draw(f), 500);
window.cancelAnimationFrame = clearTimeout;
window.Worker = class extends window.Worker {
    constructor(...given) { super(...given); window.__worker = this; }
};
"""


@contextlib.contextmanager
def launch() -> Iterator[Any]:
    """The system's Chromium, driven by playwright."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
        try:
            yield browser
        finally:
            browser.close()


class Served(NamedTuple):
    """A running `jaxrmp view`: its `process`, its page's `url`, and the frame `hand` that its goal is for."""

    process: subprocess.Popen
    url: str
    hand: str


@contextlib.contextmanager
def served(options: Sequence[str], caches: dict[str, str], said: Path, patience: float = 400.0) -> Iterator[Served]:
    """`jaxrmp view` with `options` in a process of its own, once its page is up; what it prints is in the file `said`.

    **Raises** `RuntimeError` with that where it ends, or has no page within `patience`, s.
    """
    begun = time.monotonic()
    with said.open("w") as file:
        command = [sys.executable, "-m", "jaxrmp", "view", *options, "--port", "0"]
        process = subprocess.Popen(command, stdout=file, stderr=file, env={**os.environ, **caches})
    try:
        while not (found := re.search(r"The page is at (\S+),.*?goal of (\S+),", said.read_text())):
            if process.poll() is not None or time.monotonic() - begun > patience:
                raise RuntimeError(f"no page. The command said: {said.read_text()}")
            time.sleep(0.05)
        yield Served(process, found[1], found[2])
    finally:
        process.kill()
        process.wait()


class Page:
    """A page of a session. `errors`, what its console complained of; `received`, when it was sent something; `nodes`,
    the places [4, 4] of what is on it, by name, as it was told them; `colours`, those of the arm's shapes; `on_frame`,
    called whenever it was told of places.
    """

    def __init__(self, browser: Any, url: str, size: dict[str, int] = SIZE):
        self.errors: list[str] = []
        self.received: list[float] = []
        self.nodes: dict[str, np.ndarray] = {}
        self.colours: dict[str, tuple[int, ...]] = {}
        self.on_frame: Callable[[], None] = lambda: None
        self.page = browser.new_page(viewport=size)
        self.page.on("console", lambda message: self.errors.append(message.text) if message.type == "error" else None)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("websocket", lambda ws: ws.on("framereceived", self._receive))
        self.page.add_init_script(PREPARE)
        self.page.goto(url, timeout=120_000)
        self.page.get_by_text("updates/s").wait_for(timeout=120_000)

    def _receive(self, frame: bytes) -> None:
        """viser's frames: sizes of the messages, unpacked and packed; the messages; arrays."""
        import msgspec
        import zstandard

        self.received.append(time.monotonic())
        packed = frame[16 : 16 + int.from_bytes(frame[8:16], "little")]
        told = False
        for message in msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(packed))["messages"]:
            name = message.get("name", "")
            T = self.nodes.setdefault(name, np.eye(4))
            if "/shape_" in name and name.startswith("/arm/") and "color" in message.get("props", {}):
                self.colours[name] = tuple(message["props"]["color"])
            if message["type"] == "SetPositionMessage":
                T[:3, 3], told = message["position"], True
            elif message["type"] == "SetOrientationMessage":
                T[:3, :3], told = rotation_of_quaternion(np.array(message["wxyz"])), True
        if told:
            self.on_frame()

    def click(self, name: str, done: Callable[[], Any]) -> None:
        """Press a button until it is done: a press is lost if the page draws the button anew at that instant."""
        button = self.page.get_by_role("button", name=name, exact=True)
        for _ in range(3):
            button.dispatch_event("click")
            with contextlib.suppress(AssertionError):
                return self.wait(done, f"{name} to be done", 10)
        raise AssertionError(f"{name} was pressed three times, and nothing came of it")

    def send(self, kind: str, **content: Any) -> None:
        """Have the page send a message of a kind that its gizmos and controls send."""
        message = {"type": kind, **content}
        self.page.evaluate("message => window.__worker.postMessage({type: 'send', message})", message)

    def drag(self, name: str, T: np.ndarray) -> None:
        """What the page sends while the gizmo `name` is dragged to a pose [4, 4]."""
        wxyz, position = quaternion_of_rotation(T[:3, :3]).tolist(), T[:3, 3].tolist()
        self.send("TransformControlsUpdateMessage", owner="", name=name, wxyz=wxyz, position=position)

    def play(self, name: str, poses: list[np.ndarray], every: float = 0.1) -> None:
        """Drag a gizmo along a path of poses, one every so many seconds, at the page's own pace."""
        stops = [(quaternion_of_rotation(T[:3, :3]).tolist(), T[:3, 3].tolist()) for T in poses]
        self.page.evaluate(
            """async ([name, stops, wait]) => {
                for (const [wxyz, position] of stops) {
                    const message = {type: "TransformControlsUpdateMessage", owner: "", name, wxyz, position};
                    window.__worker.postMessage({type: "send", message});
                    await new Promise(done => setTimeout(done, wait));
                }
            }""",
            [name, stops, 1000 * every],
        )

    def wait(self, condition: Callable[[], Any], what: str, timeout: float = 30.0) -> None:
        """Wait until a condition of the session holds; the page lives on meanwhile."""
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, f"waited {timeout} s for {what}"
            self.page.wait_for_timeout(20)

    def picture(self, path: Any) -> bytes:
        """A screenshot for people to look at."""
        self.page.wait_for_timeout(1000)
        return self.page.screenshot(path=str(path), timeout=120_000)

    def close(self) -> None:
        if not self.page.is_closed():
            self.page.close()
