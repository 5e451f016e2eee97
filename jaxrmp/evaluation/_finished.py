"""Starts that have ended already, kept in a file, so that an evaluation that was cut short goes on from there."""

import hashlib
import os
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np

from .._errors import ConfigurationError
from .._files import atomic_write, read_npz
from .._version import __version__
from ..kinematics._mujoco import import_mujoco
from ..simulation import Engine, Outcomes, Problem, Track

_EVERY = 5.0  # s between two writings


class Finished:
    """What came of those of N `starts` [N, n] that have ended: `done` [N], and `found`, rows of all of them.

    With a `path`, it is read from there if it is there, and written there every few seconds.
    **Raises** `ConfigurationError` for a file of another evaluation, or a damaged one.
    """

    def __init__(self, engine: Engine, problem: Problem, starts: np.ndarray, path: str | os.PathLike | None = None):
        self.path = None if path is None else Path(path)
        self.done = np.zeros(len(starts), bool)
        self.found: dict[str, np.ndarray] = {}
        self._key, self._written = _key(engine, problem, starts), time.monotonic()
        if self.path is not None and self.path.exists():
            self._read(self.path)

    def add(self, rows: np.ndarray, last: Outcomes, residual: np.ndarray, growth: np.ndarray) -> None:
        """Those of `rows` have ended so."""
        new = {"q": last.q, "qd": last.qd, "residual": residual, "growth": growth, **last.track._asdict()}
        for name, values in new.items():
            values = np.asarray(values)
            if name not in self.found:
                self.found[name] = np.zeros((len(self.done), *values.shape[1:]), values.dtype)
            self.found[name][rows] = values
        self.done[rows] = True
        if self.path is not None and time.monotonic() - self._written > _EVERY:
            self.write()

    def write(self) -> None:
        """Write what is there to the file, whole or not at all."""
        if self.path is not None and self.found:
            with atomic_write(self.path) as file:
                np.savez(file, of=self._key, done=self.done, **self.found)
            self._written = time.monotonic()

    def result(self) -> dict[str, Any]:
        """`outcomes`, `residual` and `growth` of all, once all have ended."""
        track = Track(**{name: self.found[name] for name in Track._fields})
        outcomes = Outcomes(self.found["q"], self.found["qd"], track)
        return {"outcomes": outcomes, "residual": self.found["residual"], "growth": self.found["growth"]}

    def _read(self, path: Path) -> None:
        try:
            kept = read_npz(path)
            key, self.done = str(kept.pop("of")), kept.pop("done")
            self.found = {name: kept[name] for name in ("q", "qd", "residual", "growth", *Track._fields)}
        except (ValueError, KeyError) as error:
            raise ConfigurationError(f"{str(path)!r} holds no finished starts ({error}): remove it.") from error
        if key != self._key:
            raise ConfigurationError(
                f"{str(path)!r} holds finished starts of another evaluation: of another skill, version or physics, "
                "other starts or settings. Evaluate as it was begun, or remove the file."
            )


def _key(engine: Engine, problem: Problem, starts: np.ndarray) -> str:
    """Alike for evaluations whose starts end alike."""
    digest = hashlib.sha256(np.ascontiguousarray(starts).tobytes())
    said = (
        __version__,
        engine.name,
        engine.dt,
        engine.chunk,
        engine.criteria,
        jax.tree.structure((problem.tree, problem.distances)),
    )
    digest.update(repr(said).encode())
    for leaf in jax.tree.leaves((problem.tree, problem.points, problem.distances)):
        digest.update(np.asarray(leaf).tobytes())
    if (scene := getattr(engine, "scene", None)) is not None:  # the physics, which a scene's file may have changed
        mujoco = import_mujoco()
        model = np.zeros(mujoco.mj_sizeModel(scene.model), np.uint8)
        mujoco.mj_saveModel(scene.model, None, model)
        digest.update(model.tobytes())
    return digest.hexdigest()
