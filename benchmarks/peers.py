"""The same scene by us and by the peers: those that are installed run in this call, the others are quoted."""

import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp import compiled
from jaxrmp.kinematics import panda

from . import kinematics
from ._children import in_child
from ._plots import bars
from ._policies import GOAL, OBSTACLES, SPHERES, on_device, panda_24_pairs, states
from ._timing import call_times, ratio
from ._urdf import urdf_chain

PEERS_PYTHON = Path(".venv-peers") / "bin" / "python"
AGREE = 1e-6
# Name, one call in microseconds, evaluations a second in a batch; on a machine with two
# shared cores, November 2026, same scene.
QUOTED = [
    ("RMP2, tensorflow-cpu 2.21", 23_000.0, 5_400.0),
    ("multi-robot RMPflow, NumPy, our kinematics", 42_000.0, None),
    ("hgrmpflow, PyTorch, no joint limits", 2_200_000.0, 180.0),
]
QUOTED_WHEN = "2026-11"


def rows(quick: bool = False) -> list[dict[str, Any]]:
    """The 24-pair scene: ours, fabrics from Python and exported to C, and quoted figures; then what else has peers.

    Those are kinematics and, on PyTorch, the training of a metric: rows of the benchmarks of these names, measured in
    this call. `times_ours` is the ratio of medians over turns that alternate.
    """
    found = policies(quick)
    if quick:  # the others have quick forms of their own
        return found
    found += [{"what": "kinematics", "measured": "now", **row} for row in kinematics.rows()]
    torch = in_child("benchmarks._training:rows", False)
    found += [{"what": "training", "measured": "now", **row} for row in torch]
    return found


def figure(found: list[dict[str, Any]]) -> Any:
    """One call of the policy."""
    return bars([row for row in found if row["what"] == "24 pairs"], ("median_us",), "microseconds a call")


def policies(quick: bool) -> list[dict[str, Any]]:
    """The rows of the 24-pair scene."""
    evaluate = panda_24_pairs()
    moving = on_device(evaluate.moving)
    Q, QD = states(1024)
    policy = compiled(evaluate, evaluate.moving, Q[0], QD[0])
    many = jax.jit(jax.vmap(evaluate, in_axes=(None, 0, 0)))
    q, qd = jnp.asarray(Q), jnp.asarray(QD)
    batch_us = (
        float(np.median(call_times(lambda i: many(moving, q, qd).block_until_ready(), 3 if quick else 50))) / 1024
    )
    ours = {"what": "24 pairs", "name": "jaxrmp", "measured": "now", "per_second": 1e6 / batch_us}

    def call(i):
        return policy(evaluate.moving, Q[i % 1024], QD[i % 1024])

    found = [ours]
    turns = 3 if quick else 30
    if PEERS_PYTHON.exists():
        with Fabrics() as fabrics:
            taken: dict[str, list[float]] = {"jaxrmp": [], "python": [], "c": []}
            for _ in range(turns):
                taken["jaxrmp"].append(float(np.median(call_times(call, 20 if quick else 1000))))
                taken["python"].append(float(np.median(fabrics.calls("python", 5 if quick else 100))))
                taken["c"].append(float(np.median(fabrics.calls("c", 10 if quick else 300))))
        times = {name: np.array(values) for name, values in taken.items()}
        for name, label in (("python", "fabrics 0.10.0, Python"), ("c", "fabrics 0.10.0, exported C, gcc -O0")):
            row = {"median_us": float(np.median(times[name])), "times_ours": ratio(times[name], times["jaxrmp"])}
            found.append({"what": "24 pairs", "name": label, "measured": "now", **row})
        ours["median_us"] = float(np.median(times["jaxrmp"]))
    else:
        print(f"fabrics is not here ({PEERS_PYTHON}): make peers")
        ours["median_us"] = float(np.median(call_times(call, 20 if quick else 10_000)))
    ours["times_ours"] = 1.0
    for name, one, per_second in QUOTED:
        quoted = {"median_us": one, "per_second": per_second, "times_ours": one / ours["median_us"]}
        found.append({"what": "24 pairs", "name": name, "measured": QUOTED_WHEN, **quoted})
    return found


class Fabrics:
    """fabrics in a process of its own environment, which times calls when asked; a context manager.

    **Raises** `RuntimeError` if it does not start, or its Python and its C differ.
    """

    def __enter__(self) -> "Fabrics":
        self._folder = tempfile.TemporaryDirectory()
        scene = Path(self._folder.name) / "scene.json"
        scene.write_text(json.dumps(self._scene()))
        server = Path(__file__).with_name("_fabrics_server.py")
        self._process = subprocess.Popen(
            [str(PEERS_PYTHON), str(server), str(scene)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        try:
            while self._answer() != "ready":
                pass
            if (apart := self._ask("check")) > AGREE:
                raise RuntimeError(f"fabrics from Python and its exported C differ by {apart:.1e}.")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_) -> None:
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            stream.close()  # type: ignore[union-attr]
        self._folder.cleanup()

    def calls(self, what: str, count: int) -> list[float]:
        """Microseconds of `count` calls of `python` or `c`."""
        return self._ask(f"{what} {count}")

    def _ask(self, line: str) -> Any:
        print(line, file=self._process.stdin, flush=True)
        return self._answer()

    def _answer(self) -> Any:
        """The next line that is JSON: fabrics prints of its own."""
        while True:
            line = self._process.stdout.readline()  # type: ignore[union-attr]
            if not line:
                raise RuntimeError(f"fabrics in {PEERS_PYTHON} ended with exit code {self._process.wait()}.")
            try:
                return json.loads(line)
            except json.JSONDecodeError:
                continue

    def _scene(self) -> dict[str, Any]:
        robot = panda()
        q, qd = states(64)
        return {
            "urdf": urdf_chain(robot, "panda_hand"),
            "root": "world",
            "hand": "panda_hand",
            "goal": GOAL,
            "spheres": SPHERES,
            "obstacles": OBSTACLES,
            "lower": np.asarray(robot.lower).tolist(),
            "upper": np.asarray(robot.upper).tolist(),
            "q": q.tolist(),
            "qd": qd.tolist(),
        }
