"""The camera of videos holds all that there is to see, as near as it can."""

import mujoco
import numpy as np
import pytest

from jaxrmp.visualization._framing import framing

BALLS = "".join(
    f'<body><freejoint/><geom size=".05" rgba="{k % 2} .2 .8 1" contype="0" conaffinity="0"/></body>' for k in range(6)
)
VIEW = '<camera name="view" pos="3 1 1" xyaxes="-.3 1 0 -.2 -.1 1"/>'


@pytest.mark.parametrize("camera", ["", VIEW], ids=["its own", "from the scene's view"])
@pytest.mark.parametrize("part", [(1.0, 16 / 9), (0.7, 0.8)])
def test_all_balls_are_in_the_picture_and_it_is_filled(camera, part):
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><geom type="plane" size="9 9 1"/>{camera}{BALLS}</worldbody></mujoco>'
    )
    states = []
    for seed in range(3):
        data = mujoco.MjData(model)
        data.qpos.reshape(-1, 7)[:, :3] = np.random.default_rng(seed).uniform(
            [-0.5, -0.4, 0.1], [0.6, 0.5, 0.9], (6, 3)
        )
        mujoco.mj_forward(model, data)
        states.append(data)
    found = framing(model, states, part)
    azimuth, elevation = np.radians([found.azimuth, found.elevation])
    forward = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.cross(forward, [0, 0, 1]) / np.cos(elevation)
    eye = found.lookat - found.distance * forward
    if camera:
        np.testing.assert_allclose(forward, -states[0].cam_xmat[0].reshape(3, 3)[:, 2], atol=1e-6)
    rng, slope = np.random.default_rng(9), np.tan(np.radians(model.vis.global_.fovy) / 2)
    surface = rng.normal(size=(500, 3))
    surface *= 0.05 / np.linalg.norm(surface, axis=1, keepdims=True)
    points = np.concatenate([data.geom_xpos[1:, None] + surface for data in states]).reshape(-1, 3) - eye
    depth = points @ forward
    shares = np.stack([np.abs(points @ np.cross(right, forward)), np.abs(points @ right)]) / depth / slope
    share = shares.max(1) / np.array(part)
    assert (depth > 0).all()
    assert share.max() < 0.95 and share.max() > 0.8  # a margin of an eighth, no more, on the side that bounds it
