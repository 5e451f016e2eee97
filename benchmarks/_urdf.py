"""A robot of ours as URDF, which is what the peers read: one chain, from the world to one frame's body."""

import numpy as np

from jaxrmp.kinematics import Robot


def urdf_chain(robot: Robot, tip: str) -> str:
    """The bodies from the world down to `tip` as links of the same names, with unit masses and no geometry.

    For chains of at most one hinge a body, at its origin and with its reference position at zero, as the Panda's.
    """
    model = robot.model
    body = model.frames[robot.frame_index(tip)].body
    parts = [_link("world")]
    for index in model.path(body):
        link = model.bodies[index]
        joints = [model.joints[i] for i in model.joints_of_body[index]]
        parts.append(_link(link.name))
        R = np.reshape(link.rotation, (3, 3))
        rpy = np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(np.clip(R[2, 0], -1, 1)), np.arctan2(R[1, 0], R[0, 0])
        moving = f"<origin xyz='{_numbers(link.position)}' rpy='{_numbers(rpy)}'/>"
        moving += f"<parent link='{model.bodies[link.parent].name}'/><child link='{link.name}'/>"
        if not joints:
            parts.append(f"<joint name='to_{link.name}' type='fixed'>{moving}</joint>")
            continue
        joint = joints[0]
        i = joint.coordinate
        parts.append(
            f"<joint name='{joint.name}' type='revolute'>{moving}<axis xyz='{_numbers(joint.axis)}'/>"
            f"<limit lower='{robot.lower[i]}' upper='{robot.upper[i]}' velocity='{robot.velocity_limit[i]}' "
            "effort='100'/></joint>"
        )
    return f"<?xml version='1.0'?><robot name='{robot.name}'>{''.join(parts)}</robot>"


def _link(name: str) -> str:
    inertia = "<inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/>"
    return f"<link name='{name}'><inertial><origin xyz='0 0 0'/><mass value='1'/>{inertia}</inertial></link>"


def _numbers(values) -> str:
    return " ".join(f"{float(value):.17g}" for value in values)
