"""What scenes are made of: the arm with its fingers held, the floor and the light, boxes and frames."""

from typing import Any

import numpy as np

from .._rotations import pose, quaternion_of_rotation, rotation_of_vector
from .._task_map import check_rigid
from ..kinematics import PANDA_MODEL, panda
from ..kinematics._mujoco import import_mujoco

FINGER_WIDTH = 0.04  # each finger's joint, m: as `panda()` fixes them and as the recordings of the paper have them
WOOD = [0.76, 0.6, 0.42, 1.0]
LIGHT_WOOD = [0.86, 0.74, 0.58, 1.0]
METAL = [0.35, 0.36, 0.38, 1.0]


def on_panda() -> dict[str, Any]:
    """What every scene with the built-in Panda says of it."""
    return {"robot": panda(), "hand": "panda_hand_tcp", "standing": ("panda_link0", "panda_link1")}


def arm_spec() -> Any:
    """The built-in Panda as an editable MuJoCo model, its fingers fixed open at `FINGER_WIDTH`, over a floor."""
    mujoco = import_mujoco()
    spec = mujoco.MjSpec.from_file(str(PANDA_MODEL))
    for part in (*spec.keys, *spec.equalities, *(a for a in spec.actuators if "finger" in a.name)):
        spec.delete(part)
    for joint in list(spec.joints):
        if "finger" in joint.name:
            joint.parent.pos = np.asarray(joint.parent.pos) + FINGER_WIDTH * np.asarray(joint.axis)
            spec.delete(joint)
    for i, geom in enumerate(g for body in spec.bodies[1:] for g in body.geoms):
        geom.name = geom.name or f"arm_{i}"
    spec.add_numeric(name="max_contact_points", data=[8.0])  # MJX keeps the deepest ones; each costs it time always
    spec.add_numeric(name="max_geom_pairs", data=[24.0])  # of a kind, the nearest ones, that MJX looks at for contact
    spec.visual.quality.shadowsize = 1024
    spec.visual.quality.offsamples = 0
    spec.visual.headlight.ambient = [0.35, 0.35, 0.35]
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.93, 0.95, 0.98],
        rgb2=[0.6, 0.7, 0.8],
        width=128,
        height=768,
    )
    spec.worldbody.add_light(
        pos=[1.0, 1.5, 2.5], dir=[-0.3, -0.5, -0.8], diffuse=[0.5, 0.5, 0.5], cutoff=85.0, exponent=1.0
    )
    floor = {"size": [3.0, 3.0, 0.05], "rgba": [0.82, 0.84, 0.86, 1.0]}
    meets = {"contype": 0, "conaffinity": 2}  # the wrist and the hand meet it; the base stands on it
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, **floor, **meets)
    return spec


def moved(T: np.ndarray, offset: np.ndarray, yaw: float) -> np.ndarray:
    """A pose [4, 4] moved by `offset` [3], m, in the world, and turned by `yaw`, rad, about the vertical through it."""
    return pose(T[:3, 3] + offset, rotation_of_vector(np.array([0.0, 0.0, yaw])) @ T[:3, :3])


def pose_or(T: np.ndarray | None, position: np.ndarray, yaw: float = 0.0) -> np.ndarray:
    """The pose given, or that at `position` [3], m, turned by `yaw`, rad, about the vertical."""
    return moved(np.eye(4), position, yaw) if T is None else check_rigid(T)


def before_panda(T_world_object: np.ndarray, eye: Any, target: Any) -> tuple[Any, Any]:
    """The Panda's editable model, and in it the body whose frame is the object's, which carries all of the furniture.

    The camera named "view" stands at `eye` and looks at `target`, m, both from the object, along the world's axes.
    """
    spec, position = arm_spec(), T_world_object[:3, 3]
    thing = spec.worldbody.add_body(
        name="object", mocap=True, pos=position, quat=quaternion_of_rotation(T_world_object[:3, :3])
    )
    back = np.asarray(eye, float) - np.asarray(target, float)
    back /= np.linalg.norm(back)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(back, right), back], axis=1)
    spec.worldbody.add_camera(name="view", pos=position + eye, quat=quaternion_of_rotation(axes), fovy=45.0)
    return spec, thing


def add_body(parent: Any, name: str, position: Any, axes: np.ndarray | None = None) -> Any:
    """A body at `position` in its parent, m, whose axes there are the columns of `axes`."""
    return parent.add_body(name=name, pos=position, quat=quaternion_of_rotation(np.eye(3) if axes is None else axes))


def add_box(body: Any, name: str, center: Any, half: Any, rgba: Any, mass: float = 0.0, touches: bool = True) -> None:
    """A box in a body; if it `touches`, the arm can touch it (and nothing else does)."""
    add_geom(body, "BOX", name, rgba, touches, pos=center, size=half, mass=mass)


def add_bar(body: Any, name: str, ends: Any, radius: float, rgba: Any, **settings: Any) -> None:
    """A capsule in a body between two `ends`, that the arm can touch."""
    add_geom(body, "CAPSULE", name, rgba, fromto=np.ravel(ends), size=[radius, 0.0, 0.0], **settings)


def add_geom(body: Any, kind: str, name: str, rgba: Any, touches: bool = True, **settings: Any) -> None:
    """A geometry of MuJoCo's `kind` in a body, that the arm can touch, or nothing."""
    kind = getattr(import_mujoco().mjtGeom, f"mjGEOM_{kind}")
    body.add_geom(name=name, type=kind, rgba=rgba, contype=0, conaffinity=int(touches), **settings)


def upright(forward: Any) -> np.ndarray:
    """Axes [3, 3] as columns: x along a horizontal direction, z up."""
    x = np.array([forward[0], forward[1], 0.0], float)
    x /= np.linalg.norm(x)
    return np.stack([x, [-x[1], x[0], 0.0], [0.0, 0.0, 1.0]], axis=1)
