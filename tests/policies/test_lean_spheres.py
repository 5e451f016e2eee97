"""A cover by fewer spheres keeps off the same."""

import numpy as np

from jaxrmp.kinematics import panda
from jaxrmp.policies._lean_spheres import lean
from jaxrmp.world import RobotSpheres


def test_what_lies_within_another_sphere_or_pair_is_left_out_and_nothing_else():
    frames = ("panda_hand", "panda_link7", "panda_hand_tcp", "panda_link4", "panda_link4")
    offsets = np.array([[0.0, 0, -0.05], [0.0, 0, 0], [0.0, 0, -0.1], [0.1, 0, 0], [0.11, 0, 0]])
    spheres = RobotSpheres(frames, offsets, np.array([0.1, 0.2, 0.01, 0.1, 0.02]))
    outer, own, pairs = lean(panda(), spheres, ((0, 3), (1, 3), (2, 4), (0, 4)))
    # The hand's and its tip's sphere lie within the one of the link before, as does one of two on the elbow's.
    assert outer.radii.tolist() == [0.2, 0.1] and outer.frames == ("panda_link7", "panda_link4")
    assert own.radii.tolist() == [0.2, 0.1] and pairs == ((0, 1),)
    on_axis = RobotSpheres(("panda_link1",) * 2, np.array([[0.0, 0, 0], [0.05, 0, 0]]), np.array([0.2, 0.05]))
    assert lean(panda(), on_axis, ())[0].radii.tolist() == [0.05]  # of the two, what the first joint moves
    _, own, pairs = lean(panda(), spheres, ((0, 3), (0, 4)))  # the largest need not keep apart: the small ones do
    assert own.radii.tolist() == [0.1, 0.1, 0.02] and pairs == ((0, 1), (0, 2))
