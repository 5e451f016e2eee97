"""A depth camera over a scene in MuJoCo, as trials in physics have one: what it sees is all that a policy is told."""

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ConfigurationError
from .._ranges import POSITIVE, require_number
from .._rotations import pose, rotation_angle, rotation_of_vector
from ..world import RobotSpheres
from ._camera import Camera
from ._noise import KINECT, DepthNoise, measured_depth
from ._object_model import ObjectModel
from ._render import depth_renderer
from ._robot_seen import robot_spheres
from ._settings import ObjectTrackerSettings
from ._track import Estimate, start_estimate, track

_ROUGH = 0.05, float(np.radians(15.0))  # how far off the first guess is, m and rad


class Tracking(NamedTuple):
    """How a camera followed the object through a trial.

    `images`, how many it took since the start, and in how many of these the object was `lost`; `found_s`, how long
    the object was looked for before that, s, until it was first seen, NaN if it was not; root mean squares over the
    images: `position_m` and `angle_deg`, of the pose that the policy was told, and `joints`, rad or m, of the object's
    joints by name.
    """

    images: int
    lost: int
    found_s: float
    position_m: float
    angle_deg: float
    joints: Mapping[str, float]


class DepthSight(NamedTuple):
    """What a camera carries through a trial.

    `seen` [4, 4], the object's pose where it was seen last, and its `stamp`, s, minus infinity for a guess; `frame`,
    how many images it took since the start; `estimate`, after the last one; `seed`; `found`, s, as `Tracking.found_s`;
    `lost`, in how many images; `squares` [2 + n], sums over the images of squared errors: of the position, m, the turn,
    rad, and the joints.
    """

    seen: np.ndarray
    stamp: float
    frame: int
    estimate: Estimate
    seed: tuple[int, ...]
    found: float
    lost: int
    squares: np.ndarray


@dataclass(frozen=True)
class DepthTracker:
    """A `simulation.Tracker` that looks: a camera, and what the object's pose is by its images alone.

    `model`, the object; `settings`, of the tracker; `camera`, which stands still; `noise`, its; `keep`, s, how long a
    policy goes on with a pose that is no longer seen; `before`, s, for which the object is looked for before a trial;
    `render`, a function of a `mujoco.MjData` and a `Camera`, the true depth; `step`, of an `Estimate`, a depth image, a
    `Camera` and the arm's joints, the next `Estimate`.

    Make it with `depth_tracker`.
    """

    model: ObjectModel
    settings: ObjectTrackerSettings
    camera: Camera
    noise: DepthNoise
    keep: float
    before: float
    render: Callable[[Any, Camera], np.ndarray]
    step: Callable[[Estimate, Any, Camera, Any], Estimate]

    def start(self, scene: Any, data: Any, seed: tuple[int, ...]) -> DepthSight:
        """From a guess 5 cm and 15 degrees off, look for the object of the `scene`, all at rest in `data`; `seed`, of
        the guess and the camera's noise."""
        rng, T, q = np.random.default_rng([*seed, 0]), scene.object_pose(data), self._joints(data)
        way, axis = rng.normal(size=(2, 3))
        guess = pose(
            T[:3, 3] + _ROUGH[0] * way / np.linalg.norm(way),
            rotation_of_vector(_ROUGH[1] * axis / np.linalg.norm(axis)) @ T[:3, :3],
        )
        hinges = np.array([joint.kind == "revolute" for joint in self.model.robot.model.joints], bool)
        q = q + rng.choice([-1.0, 1.0], len(q)) * np.where(hinges, _ROUGH[1], _ROUGH[0])
        q = np.clip(q, self.model.robot.lower, self.model.robot.upper)
        estimate, found = start_estimate(self.model, self.settings, guess, q), np.nan
        images = max(round(self.before * self.settings.rate), 1)
        for k in range(images):
            estimate = self._look(scene, data, estimate, (*seed, 1, k))
            if np.isnan(found) and not estimate.lost:
                found = k / self.settings.rate
        none = np.zeros(2 + len(q))
        stamp = -np.inf if estimate.lost else 0.0
        return DepthSight(np.asarray(estimate.T_world_object, float), stamp, 0, estimate, seed, found, 0, none)

    def observe(self, sight: DepthSight, time: float, scene: Any, data: Any) -> DepthSight:
        """What is seen of the `scene` in `data` at `time`, s, if an image is due then; else `sight`, as it was."""
        if time < (sight.frame + 1) / self.settings.rate - 1e-9:
            return sight
        estimate = self._look(scene, data, sight.estimate, (*sight.seed, 2, sight.frame))
        lost = bool(estimate.lost)
        seen = np.asarray(estimate.T_world_object, float)
        T = scene.object_pose(data)
        error = [
            np.linalg.norm(seen[:3, 3] - T[:3, 3]),
            rotation_angle(T[:3, :3].T @ seen[:3, :3]),
            *(np.asarray(estimate.q, float) - self._joints(data)),
        ]
        return sight._replace(
            seen=seen,
            stamp=sight.stamp if lost else time,
            frame=sight.frame + 1,
            estimate=estimate,
            lost=sight.lost + lost,
            squares=sight.squares + np.square(error),
        )

    def age(self, sight: DepthSight, time: float) -> float:
        """Seconds at `time`, s, since the image of `sight` that last showed the object."""
        return time - sight.stamp

    def report(self, sight: DepthSight) -> Tracking:
        """How it went up to `sight`."""
        position, angle, *joints = np.sqrt(sight.squares / max(sight.frame, 1)).tolist()
        names = self.model.robot.joint_names
        of_joints = dict(zip(names, joints, strict=True))
        return Tracking(sight.frame, sight.lost, float(sight.found), position, float(np.degrees(angle)), of_joints)

    def _look(self, scene: Any, data: Any, estimate: Estimate, seed: tuple[int, ...]) -> Estimate:
        depth = measured_depth(self.noise, self.render(data, self.camera), np.random.default_rng(seed))
        return self.step(estimate, depth, self.camera, data.qpos[scene.arm_qpos].astype(depth.dtype))

    def _joints(self, data: Any) -> np.ndarray:
        return np.array([data.joint(name).qpos[0] for name in self.model.robot.joint_names])


def check_names(scene: Any, model: ObjectModel) -> None:
    """**Raises** `ConfigurationError` for joints of the `model` that have no name in the `scene`."""
    named = {scene.model.joint(j).name for j in range(scene.model.njnt)}
    if unnamed := sorted(set(model.robot.joint_names) - named):
        raise ConfigurationError(
            f"the object of scene {scene.name!r} has joints without a name ({', '.join(unnamed)}), which cannot be "
            "compared with what is seen: name them in the scene's model."
        )


@contextlib.contextmanager
def depth_tracker(
    scene: Any,
    model: ObjectModel,
    camera: Camera,
    spheres: RobotSpheres | None = None,
    *,
    settings: ObjectTrackerSettings | None = None,
    noise: DepthNoise = KINECT,
    keep: float = 0.5,
    before: float = 1.0,
) -> Iterator[DepthTracker]:
    """Within it, a depth `camera` over a `scene` for `simulation.run_trials`: of the object's pose, a policy knows what
    its images say.

    Images are MuJoCo's, with `noise`, as many a second as the `settings` say, and reach the policy at once. Before a
    trial the object is looked for, from a guess that is 5 cm and 15 degrees off. Where it is lost the pose stays where
    it was last seen, and after `keep` seconds the arm brakes.

    **Arguments**: `scene`, a `scenes.Scene`; `model`, its object, `object_model(scene.model, scene.object)`; `camera`,
    where it stands (`overhead_camera`); `spheres` that hold the robot, None where there are none: what belongs to the
    arm may then be taken for the object; `before`, s, for which the object is looked for before a trial.
    **Raises** `ConfigurationError` where MuJoCo cannot draw, for an object whose joints have no name, or times that are
    not positive.
    """
    settings = settings or ObjectTrackerSettings()
    require_number("depth_tracker", "keep", keep, POSITIVE)
    require_number("depth_tracker", "before", before, POSITIVE)
    check_names(scene, model)

    def step(estimate: Estimate, depth: Any, camera: Camera, q: Any) -> Estimate:
        held = robot_spheres(scene.robot, spheres, q) if spheres is not None else (jnp.zeros((0, 3)), jnp.zeros(0))
        return track(model, settings, estimate, depth, camera, *held, noise)

    with depth_renderer(scene.model, camera.width, camera.height) as render:
        yield DepthTracker(model, settings, camera, noise, keep, before, render, jax.jit(step))
