"""Arms of any number of joints, described for MuJoCo: what scaling with degrees of freedom is measured on."""

from jaxrmp.kinematics import Robot, load_robot_from_string

_AXES = ("0 0 1", "0 1 0", "1 0 0", "0 1 0")


def serial_arms(*joints: int, length: float = 1.2) -> Robot:
    """Arms side by side, `length` metres long, with that many hinges each, whose axes take turns. The bodies of the
    first are `arm0_link1` and so on, from the base to the tip."""
    arms = "".join(_arm(k, n, length) for k, n in enumerate(joints))
    return load_robot_from_string(
        f'<mujoco model="arms{joints}"><compiler angle="radian"/><worldbody>{arms}</worldbody></mujoco>'
    )


def _arm(k: int, joints: int, length: float) -> str:
    opened = "".join(
        f'<body name="arm{k}_link{i}" pos="{f"0 0 {length / joints}" if i > 1 else f"{0.5 * k} 0 0"}">'
        f'<joint name="arm{k}_joint{i}" type="hinge" axis="{_AXES[i % 4]}" range="-2.9 2.9" limited="true"/>'
        '<geom type="sphere" size="0.01" mass="1"/>'
        for i in range(1, joints + 1)
    )
    return opened + "</body>" * joints
