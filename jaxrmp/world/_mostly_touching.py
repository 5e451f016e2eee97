"""Pairs of a robot's spheres that touch in most configurations, which is no collision but how links are covered."""

import numpy as np

from ..kinematics import Robot
from ._robot_spheres import RobotSpheres

_CONFIGURATIONS = 200


def without_mostly_touching(robot: Robot, spheres: RobotSpheres, pairs) -> tuple[tuple[int, int], ...]:
    """The `pairs` of which the spheres are apart in at least half of many configurations within the joints' limits."""
    if not pairs:
        return ()
    first, second = np.array(pairs).T
    sums = np.asarray(spheres.radii)[first] + np.asarray(spheres.radii)[second]
    touching, configurations = np.zeros(len(pairs), int), _configurations(robot)
    for q in configurations:
        centers = _centers(robot, spheres, q)
        touching += np.linalg.norm(centers[first] - centers[second], axis=1) < sums
    apart = 2 * touching < len(configurations)
    return tuple(pair for pair, keep in zip(pairs, apart, strict=True) if keep)


def _configurations(robot: Robot) -> np.ndarray:
    """The middle of the joints' ranges, and random ones in them; joints without limits turn once."""
    lower, upper = (np.asarray(limit, float) for limit in (robot.lower, robot.upper))
    lower, upper = np.where(np.isfinite(lower), lower, -np.pi), np.where(np.isfinite(upper), upper, np.pi)
    random = np.random.default_rng(0).uniform(size=(_CONFIGURATIONS, robot.num_joints))
    return np.concatenate([(lower + upper)[None] / 2, lower + random * (upper - lower)])


def _centers(robot: Robot, spheres: RobotSpheres, q: np.ndarray) -> np.ndarray:
    """The centres [K, 3] in the world, in NumPy: nothing is compiled for a few hundred configurations."""
    model, poses = robot.model, [(np.eye(3), np.zeros(3))]
    for b, body in enumerate(model.bodies[1:], 1):
        R, p = poses[body.parent]
        R, p = R @ np.reshape(body.rotation, (3, 3)), R @ np.array(body.position) + p
        for joint in (model.joints[i] for i in model.joints_of_body[b]):
            value = joint.offset + (joint.multiplier * q[joint.coordinate] if joint.coordinate >= 0 else 0)
            value, axis, anchor = value - joint.reference, np.array(joint.axis), np.array(joint.anchor)
            if joint.kind == "prismatic":
                p = p + R @ axis * value
            else:
                turn = _rotation(axis, value)
                R, p = R @ turn, p + R @ (anchor - turn @ anchor)
        poses.append((R, p))
    centers = []
    for name, offset in zip(spheres.frames, np.asarray(spheres.offsets), strict=True):
        frame = model.frames[robot.frame_index(name)]
        R, p = poses[frame.body]
        centers.append(R @ (np.reshape(frame.rotation, (3, 3)) @ offset + frame.position) + p)
    return np.array(centers)


def _rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
