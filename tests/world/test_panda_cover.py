"""The built-in Panda's spheres as plain numbers are those that are found from its file."""

from dataclasses import replace

import numpy as np

from jaxrmp.kinematics import PANDA_MODEL, load_robot, panda
from jaxrmp.world import ignored_by_model, own_spheres, panda_spheres, spheres_from_model
from jaxrmp.world._make_panda_cover import found_cover
from jaxrmp.world._own_spheres import found_spheres
from jaxrmp.world._panda_cover import built_in_cover, panda_cover
from jaxrmp.world._self_pairs import link_of


def assert_same(a, b):
    assert a.frames == b.frames
    np.testing.assert_allclose(a.offsets, b.offsets, atol=1e-9)
    np.testing.assert_allclose(a.radii, b.radii, atol=1e-9)
    np.testing.assert_allclose(a.coverage_error, b.coverage_error, atol=1e-9)


def test_they_are_what_is_found():
    """Else: python -m jaxrmp.world._make_panda_cover"""
    cover, found = panda_cover(), found_cover()
    assert_same(cover.spheres, found.spheres)
    assert_same(cover.hand, found.hand)
    assert cover.ignored == found.ignored


def test_for_any_hand_they_are_as_found():
    robot = panda()
    for hand in ((), ("panda_hand_tcp",), ("panda_link5",), ("world", "panda_leftfinger")):
        assert_same(own_spheres(robot, hand), found_spheres(robot, {link_of(robot, name) for name in hand}))
    assert own_spheres(robot) is panda_spheres()


def test_they_are_of_the_whole_robot_of_that_file_and_of_no_other():
    robot = panda()
    assert built_in_cover(robot) is panda_cover()
    whole = load_robot(PANDA_MODEL)  # with fingers that move
    assert built_in_cover(whole) is panda_cover() and ignored_by_model(whole) == ignored_by_model(PANDA_MODEL)
    assert built_in_cover(replace(robot, model=replace(robot.model, source="elsewhere/panda.xml"))) is None
    coarse = panda_spheres(0.03)
    assert coarse.size < panda_spheres().size
    assert_same(coarse, spheres_from_model(PANDA_MODEL, 0.03))
