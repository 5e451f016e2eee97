"""Serial arms of any number of joints, described for MuJoCo: what scaling with degrees of freedom is measured on."""

from jaxrmp.kinematics import Robot, load_robot_from_string

_AXES = ("0 0 1", "0 1 0", "1 0 0", "0 1 0")


def serial_arm(joints: int, length: float = 1.2) -> Robot:
    """An arm of that many hinges, `length` metres long, with axes that take turns; its bodies are `link1` and so on."""
    opened = "".join(
        f'<body name="link{i}" pos="0 0 {length / joints if i > 1 else 0}">'
        f'<joint name="joint{i}" type="hinge" axis="{_AXES[i % 4]}" range="-2.9 2.9" limited="true"/>'
        '<geom type="sphere" size="0.01" mass="1"/>'
        for i in range(1, joints + 1)
    )
    return load_robot_from_string(
        f'<mujoco model="serial{joints}"><compiler angle="radian"/><worldbody>{opened}{"</body>" * joints}'
        "</worldbody></mujoco>"
    )
