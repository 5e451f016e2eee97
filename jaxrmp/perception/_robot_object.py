"""A robot as an object that a camera sees."""

from .._errors import NoGeometryError
from ..kinematics import Robot
from ..world import geometry_of_model
from ._object_model import ObjectModel, looks_of, model_of_shapes, shapes_of_geoms


def robot_object(
    robot: Robot,
    points: int = 2000,
    *,
    spacing: float = 0.004,
    looks: bool = True,
    margin: float = 0.03,
    sets: int = 16,
    seed: int = 0,
) -> ObjectModel:
    """A `robot` as an object in depth images, its base being the robot's world, by the geometry of its own file.

    Of a link what is only looks counts, if it has such, else what collides: boxes, capsules, cylinders and spheres as
    they are, meshes as signed distances on a grid, which takes seconds for a robot.

    **Arguments**: `spacing`, between the grid's points, m; `looks`, or else what collides counts first; `points`,
    `margin`, `sets`, `seed`, as `object_model`.
    **Raises** `NoGeometryError` for a robot that was read from no file, or has no geometry on its links, or such as
    `object_model` has no shape for; `RobotError` if its meshes cannot be read.
    """
    m = geometry_of_model(robot, looks=looks)
    bodies = {m.body(b).name: b for b in range(1, m.nbody)}
    known = [(k, bodies[body.name]) for k, body in enumerate(robot.model.bodies) if body.name in bodies]
    found = {k: looks_of(m, body, looks) for k, body in known}
    links = [k for k, geoms in found.items() if geoms]
    if not links:
        raise NoGeometryError(f"the links of {robot.name!r} have no geometry that a camera could see.")
    return model_of_shapes(
        robot, links, [shapes_of_geoms(m, found[k], spacing) for k in links], points, margin, sets, seed
    )
