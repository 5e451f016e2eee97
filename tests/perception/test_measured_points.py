"""Whose the points of a depth image are."""

import jax
import numpy as np
import pytest

from jaxrmp.perception import (
    OBJECT,
    OTHER,
    ROBOT,
    ObjectTrackerSettings,
    depth_renderer,
    measured_points,
    start_estimate,
)

from .conftest import T_WORLD_OBJECT, camera, model_and_data, thing


def test_points_are_told_apart_as_the_objects_the_robots_and_others(can_draw):
    if not can_draw:
        pytest.skip("needs OSMesa or a display")
    m, data = model_and_data()
    model, settings, eye = thing(m), ObjectTrackerSettings(), camera()
    with depth_renderer(m, eye.width, eye.height) as render:
        depth = render(data, eye)
    depth[:20] = 0.0
    seen = start_estimate(model, settings, T_WORLD_OBJECT, np.array([0.5, 0.08]))._replace(lost=np.array(False))
    sphere = np.array([[0.1, 0.0, 0.6]]), np.array([0.05])  # upon the cabinet's top
    sort = jax.jit(lambda estimate, depth: measured_points(model, settings, estimate, depth, eye, *sphere))
    found = jax.tree.map(np.asarray, sort(seen, depth))
    p, whose, known = found.points, found.whose, found.known
    assert len(p) == 32 * 24 and not known[:64].any() and known[64:].all()
    floor, inside = np.abs(p[:, 2]) < 0.01, np.linalg.norm(p - sphere[0][0], axis=1) < 0.055
    assert set(whose[known & floor]) == {OTHER}
    assert inside.any() and set(whose[known & inside]) == {ROBOT}
    above = known & (p[:, 2] > 0.25) & (np.linalg.norm(p - sphere[0][0], axis=1) > 0.07)
    assert above.sum() > 50 and set(whose[above]) == {OBJECT}
    lost = jax.tree.map(np.asarray, sort(seen._replace(lost=np.array(True)), depth))
    assert set(lost.whose[above]) == {OTHER} and set(lost.whose[known & inside]) == {ROBOT}
