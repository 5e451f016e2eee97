"""Paths on the page: demonstrations, reproductions, the trace of the hand, and triangles of control points."""

from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..learning import resample_by_arc_length

DEMONSTRATED, REPRODUCED, TRACE, TARGET = (0, 114, 178), (213, 94, 0), (0, 158, 115), (230, 159, 0)
_INSTANTS = 7
_LINE_POINTS = 50  # of a path: more cost a page without a graphics card dearly, and show no more
_TRACE_POINTS = 100


def segments(path: np.ndarray) -> np.ndarray:
    """A path [T, 3] as the segments [T - 1, 2, 3] from each point to the next."""
    return np.stack([path[:-1], path[1:]], axis=1)


def outline(points: np.ndarray) -> np.ndarray:
    """The segments of one closed outline through K points [K, 3]: K of them, one for two points, none for one."""
    if len(points) < 2:
        return np.zeros((0, 2, 3))
    return segments(np.concatenate([points, points[:1]] if len(points) > 2 else [points]))


class PathLines:
    """Paths of control points below the node of a frame, N arrays [T, K, 3], with their triangles at
    instants even in arc length."""

    def __init__(self, server: Any, name: str, paths: Sequence[np.ndarray], color: tuple[int, int, int], width: float):
        thinned = [resample_by_arc_length(path, min(_LINE_POINTS, len(path))) for path in paths]
        lines = [segments(path[:, k]) for path in thinned for k in range(path.shape[1])]
        shapes = [outline(shape) for path in paths for shape in resample_by_arc_length(path, _INSTANTS)]
        self._lines = _add(server, f"{name}/lines", np.concatenate(lines), color, width)
        self._triangles = _add(server, f"{name}/triangles", np.concatenate(shapes), color, 0.6 * width)

    def show(self, lines: bool, triangles: bool) -> None:
        """Show the lines, and their triangles with them."""
        self._lines.visible = lines
        if self._triangles is not None:
            self._triangles.visible = lines and triangles

    def remove(self) -> None:
        """Take it off the page."""
        for node in (self._lines, self._triangles):
            if node is not None:
                node.remove()


class Trace:
    """Where the hand has been lately."""

    def __init__(self, server: Any):
        self._points: deque[np.ndarray] = deque(maxlen=_TRACE_POINTS)
        self._node = _add(server, "/trace", np.zeros((1, 2, 3)), TRACE, 2.0)

    def add(self, point: np.ndarray) -> None:
        """Go on to a point [3]."""
        if self._points and np.linalg.norm(point - self._points[-1]) < 1e-3:
            return
        self._points.append(np.asarray(point))
        if len(self._points) > 1:
            self._node.points = segments(np.stack(self._points)).astype(np.float32)

    def show(self, visible: bool) -> None:
        """Show the trace or hide it."""
        self._node.visible = visible


def add_outline(server: Any, name: str, points: np.ndarray, color: tuple[int, int, int]) -> Any:
    """The triangle of control points [K, 3] as a node; None for less than two."""
    return _add(server, name, outline(points), color, 4.0)


def _add(server: Any, name: str, pairs: np.ndarray, color: tuple[int, int, int], width: float) -> Any:
    if not len(pairs):
        return None
    return server.scene.add_line_segments(
        name, pairs.astype(np.float32), colors=color, thickness=width, thickness_units="screen"
    )
