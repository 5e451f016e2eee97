"""A real, headless Chromium, and pages of ours in it, used as a person uses them."""

import contextlib
import shutil
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from jaxrmp._rotations import quaternion_of_rotation

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


class Page:
    """A page of a session. `errors`, what its console complained of; `received`, when it was sent something."""

    def __init__(self, browser: Any, url: str):
        self.errors: list[str] = []
        self.received: list[float] = []
        self.page = browser.new_page(viewport=SIZE)
        self.page.on("console", lambda message: self.errors.append(message.text) if message.type == "error" else None)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("websocket", lambda ws: ws.on("framereceived", lambda _: self.received.append(time.monotonic())))
        self.page.add_init_script(PREPARE)
        self.page.goto(url, timeout=120_000)
        self.page.get_by_text("updates/s").wait_for(timeout=120_000)

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


@pytest.fixture(scope="module")
def chromium():
    """A browser for the tests of one file, or a skip that says what is missing."""
    pytest.importorskip("viser", reason="needs viser: pip install 'jaxrmp[viewer]'")
    pytest.importorskip("playwright", reason="needs playwright: pip install 'jaxrmp[dev]'")
    if shutil.which("chromium") is None:
        pytest.skip("needs Chromium (as root: apt-get install chromium), which make test installs where it may")
    with launch() as browser:
        yield browser


@pytest.fixture(scope="module")
def page_of(chromium):
    """The page of a session, `page_of(session)`: opened once for the tests of one file."""
    opened = {}

    def open_page(session) -> Page:
        if id(session) not in opened or opened[id(session)].page.is_closed():
            opened[id(session)] = Page(chromium, session.url)
        return opened[id(session)]

    yield open_page
    for page in opened.values():
        page.close()
