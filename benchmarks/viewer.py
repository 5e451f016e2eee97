"""The live viewer: whether the policy keeps its 1 kHz, and how often the page is told, with a browser and without.

A door skill, learned here in a few seconds, runs in its scene while its object is dragged to and fro. With Chromium and
playwright there, a page shows it: what arrives in the page is counted there, as are the pictures it draws (on this
machine's graphics: without a graphics card they are drawn in software, on the cores that the policy needs too).
"""

import shutil
import time
from typing import Any

import numpy as np

from jaxrmp.kinematics import panda
from jaxrmp.learning import learn, load_configuration
from jaxrmp.scenes import scene
from jaxrmp.synthetic import synthetic_demonstrations
from jaxrmp.viewer import Viewer, reach_content, skill_content

SECONDS = 10.0
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--enable-unsafe-swiftshader"]
LESS = {"metric.updates": 200, "potential.widths": [0.05], "potential.basin_starts": 100}
COUNT_PICTURES = """seconds => new Promise(done => {
    let pictures = 0;
    const start = performance.now();
    const next = () => {
        pictures += 1;
        const passed = (performance.now() - start) / 1000;
        if (passed > seconds) done(pictures / passed); else requestAnimationFrame(next);
    };
    requestAnimationFrame(next);
})"""


def rows() -> list[dict[str, Any]]:
    """A row for each of: the skill and the hand-designed policy, with a page open and without."""
    configuration = load_configuration("configs/door_reaching.toml", LESS)
    learning = learn(configuration, panda(), synthetic_demonstrations("door_reaching"))
    skill, prepared = learning.skill, learning.prepared
    place = scene("door", T_world_object=np.asarray(skill.T_world_object, float))
    found = []
    content = skill_content(skill, panda(), prepared, scene=place, balls=0)
    found += _of("skill in its scene", Viewer(content, 0, skill=skill, prepared=prepared))
    found += _of("hand-designed, a ball in the way", Viewer(reach_content(balls=1), 0))
    return found


def _of(name: str, viewer: Viewer) -> list[dict[str, Any]]:
    begin = time.perf_counter()
    viewer.start()
    started = time.perf_counter() - begin
    try:
        time.sleep(1.0)
        found = [{"policy": name, "page": "no", "start s": started, **_measure(viewer)}]
        if shutil.which("chromium"):
            found.append({"policy": name, "page": "yes", "start s": started, **_with_page(viewer)})
        return found
    finally:
        viewer.stop()


def _measure(viewer: Viewer, seconds: float = SECONDS) -> dict[str, Any]:
    """Rates over so many seconds, while the object is dragged to and fro."""
    home = np.array(viewer.target.position)
    first, lost = viewer.loop.frame, viewer.loop.frame.rates.lost
    drawn, start = viewer.drawn, time.perf_counter()
    while (passed := time.perf_counter() - start) < seconds:
        viewer.target.position = home + 0.05 * np.sin(2.0 * passed) * np.array([1.0, 0.0, 0.0])
        time.sleep(0.02)
    last = viewer.loop.frame
    return {
        "steps/s": (last.time - first.time) * 1000 / passed,
        "s behind": last.rates.lost - lost,
        "frames/s": (last.number - first.number) / passed,
        "updates/s": (viewer.drawn - drawn) / passed,
    }


def _with_page(viewer: Viewer) -> dict[str, Any]:
    from concurrent.futures import ThreadPoolExecutor

    from playwright.sync_api import sync_playwright

    arrived: list[float] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
        page = browser.new_page(viewport={"width": 1200, "height": 800})
        page.on("websocket", lambda ws: ws.on("framereceived", lambda _: arrived.append(time.perf_counter())))
        page.goto(viewer.url)
        page.get_by_text("updates/s").wait_for(timeout=60_000)
        page.wait_for_timeout(2000)
        with ThreadPoolExecutor(1) as other:
            before, start = len(arrived), time.perf_counter()
            measured = other.submit(_measure, viewer)
            pictures = page.evaluate(COUNT_PICTURES, SECONDS)
            result = measured.result()
            passed = time.perf_counter() - start
        page.wait_for_timeout(100)
        result |= {"arrived/s": (len(arrived) - before) / passed, "pictures/s": pictures}
        browser.close()
    return result
