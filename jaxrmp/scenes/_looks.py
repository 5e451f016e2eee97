"""How pictures of a scene look: a floor to judge distances by, and light from two sides."""

from typing import Any

from ..kinematics._mujoco import import_mujoco

_FLOOR = "picture_floor"
_TILES = [0.86, 0.87, 0.88], [0.79, 0.81, 0.83]
_KEY, _FILL = (0.55, 0.55, 0.53), (0.26, 0.27, 0.3)  # a warm light that casts shadows, a cool one that casts none


def add_looks(spec: Any, smooth: bool = False) -> None:
    """Give a `mujoco.MjSpec` that is drawn tiles on its planes that have no material, and light; with `smooth`, edges
    without steps, which takes twice the time."""
    mujoco = import_mujoco()
    spec.visual.quality.shadowsize, spec.visual.quality.offsamples = 2048, 4 * smooth
    head = spec.visual.headlight
    head.ambient, head.diffuse, head.specular = [0.38] * 3, [0.2] * 3, [0.0] * 3
    spec.add_texture(
        name=_FLOOR,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=_TILES[0],
        rgb2=_TILES[1],
        width=256,
        height=256,
    )
    tiles = spec.add_material(name=_FLOOR, texrepeat=[2.0, 2.0], texuniform=True, specular=0.1, shininess=0.1)
    tiles.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = _FLOOR
    for geom in spec.worldbody.geoms:
        if geom.type == mujoco.mjtGeom.mjGEOM_PLANE and not geom.material:
            geom.material, geom.rgba = _FLOOR, [1.0, 1.0, 1.0, geom.rgba[3]]
    lights = [light for body in spec.bodies for light in body.lights]
    for light in lights:
        light.diffuse, light.specular = _KEY, [0.15] * 3
    if not lights:
        spec.worldbody.add_light(
            pos=[1.0, 1.5, 2.5], dir=[-0.3, -0.5, -0.8], diffuse=_KEY, specular=[0.15] * 3, cutoff=85.0, exponent=1.0
        )
    spec.worldbody.add_light(
        pos=[-1.5, -2.0, 2.5], dir=[0.4, 0.6, -0.7], diffuse=_FILL, specular=[0.0] * 3, cutoff=85.0, castshadow=False
    )
