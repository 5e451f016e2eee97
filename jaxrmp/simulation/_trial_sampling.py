"""Which trials a run makes: from the demonstrated starts, then from seeded variations of them."""

from collections.abc import Sequence

import numpy as np

from .._errors import ConfigurationError
from ..kinematics._mujoco import import_mujoco
from ..scenes import Scene
from ._trials import Displacement, Trial, moved

START_SPREAD = 0.15
"""Of every joint around a demonstrated start, rad."""
OBJECT_SPREAD = 0.10, float(np.radians(15.0))
"""How far the door is moved, m, and turned about the vertical, rad, at most."""
DISPLACEMENT = 0.10
"""How far the object is displaced during execution, m."""
CYLINDER_SPREAD = 0.03
"""Of the cylinder's place, m, in each horizontal direction."""
LEAST_CROSSED = 4
"""A seeded cylinder stands in the way of at least this many demonstrations."""
_ATTEMPTS = 1000


def sample_trials(
    scene: Scene,
    paths: Sequence[np.ndarray],
    poses: Sequence[np.ndarray],
    count: int,
    *,
    seed: int = 0,
    displace: bool = False,
) -> list[Trial]:
    """The demonstrated starts, each with the object where it was then, and after them variations of them in turn.

    Variations: in scene `drawer` every joint of the start by up to `START_SPREAD`; in `drawer_obstacle` the cylinder's
    place by up to `CYLINDER_SPREAD`, a new one for every round of starts, so that it stands in the way of at least
    `LEAST_CROSSED` demonstrations (or all, if fewer); in `door` the door moved by up to `OBJECT_SPREAD`. With
    `displace` the variation is another one: the object moved by `DISPLACEMENT` in a random horizontal direction, 0.5 to
    2.5 s after the start, in every trial. Variations in collision at the start are drawn again.

    **Arguments**: `paths`, N demonstrations [T, n], rad; `poses`, the object's N poses [4, 4] in them; the same `seed`
    gives the same trials, whatever `count` is.
    **Raises** `ConfigurationError` for a count below one, a demonstrated start in collision, or if no variation free of
    collision is found.
    """
    if count < 1:
        raise ConfigurationError(f"trials is {count}: give at least one.")
    trials = []
    for k in range(count):
        i, rng = k % len(paths), np.random.default_rng([seed, k])
        trial = Trial(np.asarray(paths[i][0], float), np.asarray(poses[i], float))
        if k >= len(paths) and not displace:
            trial = _variation(scene, trial, paths, poses, [seed, k, k // len(paths)])
        if displace:
            angle, start = rng.uniform(-np.pi, np.pi), rng.uniform(0.5, 2.5)
            offset = DISPLACEMENT * np.array([np.cos(angle), np.sin(angle), 0.0])
            trial = trial._replace(displacement=Displacement(offset, start=start))
        trials.append(trial)
    return trials


def demonstrations_crossed(scene: Scene, paths: Sequence[np.ndarray], poses: Sequence[np.ndarray]) -> int:
    """In how many demonstrations the arm would touch what it must not, the cylinder in particular, had it stood there.

    **Arguments** as `sample_trials`; every fourth sample is looked at.
    """
    return sum(_touches(scene.with_object(T), np.asarray(q)[::4]) for q, T in zip(paths, poses, strict=True))


def _variation(scene: Scene, trial: Trial, paths, poses, key: list[int]) -> Trial:
    robot = scene.robot
    rng = np.random.default_rng([key[0], key[2], 7] if scene.name == "drawer_obstacle" else [key[0], key[1], 7])
    for _ in range(_ATTEMPTS):
        found = trial
        if scene.name == "drawer":
            q = trial.q + rng.uniform(-START_SPREAD, START_SPREAD, len(trial.q))
            found = trial._replace(q=np.clip(q, np.asarray(robot.lower), np.asarray(robot.upper)))
        elif scene.name == "door":
            found = trial._replace(T_world_object=_moved_door(trial.T_world_object, rng))
        elif scene.cylinder is not None:
            place = np.array(scene.cylinder.center) + rng.uniform(-CYLINDER_SPREAD, CYLINDER_SPREAD, 2)
            there = scene.with_cylinder((place[0], place[1]))
            free = not any(_touches(there.with_object(T), q[:1]) for q, T in zip(paths, poses, strict=True))
            if not free or demonstrations_crossed(there, paths, poses) < min(LEAST_CROSSED, len(paths)):
                continue
            return trial._replace(cylinder=(float(place[0]), float(place[1])))
        if not _touches(scene.with_object(found.T_world_object), found.q[None]):
            return found
    raise ConfigurationError(f"no variation of scene {scene.name!r} free of collision in {_ATTEMPTS} attempts.")


def _moved_door(T: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    direction = rng.normal(size=3)
    offset = OBJECT_SPREAD[0] * rng.uniform() ** (1 / 3) * direction / np.linalg.norm(direction)
    return moved(T, offset, rng.uniform(-OBJECT_SPREAD[1], OBJECT_SPREAD[1]))


def _touches(scene: Scene, path: np.ndarray) -> bool:
    """Whether the arm touches what it must not anywhere on a path [T, n]."""
    mujoco = import_mujoco()
    data = mujoco.MjData(scene.model)
    scene.place(data, scene.T_world_object)
    data.qpos[scene.model.joint(scene.joint).qposadr[0]] = scene.start
    for q in path:
        data.qpos[scene.arm_qpos] = q
        mujoco.mj_kinematics(scene.model, data)
        mujoco.mj_collision(scene.model, data)
        if scene.contacts(data):
            return True
    return False
