"""How an object is tracked."""

from .._ranges import NonNegative, Positive, settings


@settings("object_tracker")
class ObjectTrackerSettings:
    """What the tracker believes of the camera, the object's motion, and when it has lost it.

    `rate`, images a second.

    Measuring: `model_error`, m, how exact the object's shapes are; `gates`, m, one for each step of Gauss-Newton, by
    which residuals count beyond three standard deviations; `clearance`, m, by which a ray must enter a part before the
    point that it ends at to have seen through it; `outline_error`, m, of outlines; `robot_margin`, m, by which the
    robot's spheres are widened; `trust`, the share of what the measurements say, were their errors independent, that
    is believed.

    Motion, from frame to frame, each for a second: `drift`, m and rad, of the base, whose pose is nearly constant;
    `jerkiness`, of the joints' speeds, rad/s or m/s.

    Losing: a link is seen where its points are `enough` of what is looked for on it, at least, and the rays that go
    through it by more than `through`, m, are `contradicted` of both together, at most.

    Finding: `guesses` a frame: where it was last seen, the best guess of the frame before, and others that are
    `spread`, m and rad, round these two, their joints anywhere in their ranges; `search_points`, pixels looked at for
    each, at most as many as to follow it; `search_gates`, as above; `confirm`, images in a row in which it must be
    seen, before guesses are no longer compared with it; `better`, by how much one must be to be preferred, in roots of
    points; `seed`, of all chance.

    **Raises** `ConfigurationError` for a value that makes no sense.
    """

    rate: Positive[float] = 30.0
    model_error: Positive[float] = 0.001
    gates: NonNegative[tuple[float, ...]] = (0.02, 0.01, 0.005)
    clearance: Positive[float] = 0.015
    outline_error: Positive[float] = 0.004
    robot_margin: NonNegative[float] = 0.01
    trust: Positive[float] = 0.05
    drift: Positive[tuple[float, float]] = (0.01, 0.02)
    jerkiness: Positive[float] = 3.0
    enough: Positive[float] = 0.05
    contradicted: Positive[float] = 0.1
    through: Positive[float] = 0.02
    guesses: Positive[int] = 7
    spread: Positive[tuple[float, float]] = (0.05, 0.25)
    search_points: Positive[int] = 400
    search_gates: NonNegative[tuple[float, ...]] = (0.12, 0.08, 0.05, 0.03)
    confirm: Positive[int] = 6
    better: NonNegative[float] = 1.0
    seed: int = 0
