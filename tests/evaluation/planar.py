"""Two joints, a potential with a goal, wells beside it and a pull into the limits: every kind of end, compiled fast."""

import json
import sys

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import Partial

from jaxrmp import Distance, GeometricDynamicalSystem, TaskMap, pytree
from jaxrmp.evaluation import evaluate, join_processes, sample_starts
from jaxrmp.leaves import JointLimit
from jaxrmp.simulation import KinematicEngine, Problem, StopCriteria

LIMITS = JointLimit(np.full(2, -2.0), np.full(2, 2.0))
CRITERIA = StopCriteria(duration=40.0)


@pytree
class Row(TaskMap):
    """x [2] as one point [1, 2]."""

    def __call__(self, x):
        return x[None]


@pytree
class One(TaskMap):
    """A distance as [1]."""

    distance: Distance

    def __call__(self, x):
        return self.distance(x).reshape(1)


def potential(height, x):
    """Wells in x[0] at 0, 1, 2 and their mirror images, in x[1] at 0 and at the limits."""
    return height * (1 - jnp.cos(2 * jnp.pi * x[0]) + 1 - jnp.cos(jnp.pi * x[1])) + 0.05 * jnp.sum(x**2)


def mass(x, xd):
    return jnp.eye(2)


def damping(x, xd):
    return 10 * jnp.eye(2)


def planar(height: float = 1.0) -> Problem:
    leaf = GeometricDynamicalSystem.of(Partial(mass), Partial(potential, jnp.float32(height)), Partial(damping))
    obstacle = One(Distance(jnp.array([-1.5, -1.5]), 0.3))
    row = Row()
    return Problem(leaf + LIMITS, row, row, LIMITS.lower, LIMITS.upper, (obstacle,))


def run(batch: int) -> dict:
    problem = planar()
    engine = KinematicEngine(problem, CRITERIA, dt=0.01, chunk=50)
    found = evaluate(engine, problem, LIMITS, sample_starts(problem, 42, seed=3), batch=batch)
    return {
        "devices": jax.device_count(),
        "q": found.outcomes.q.tolist(),
        "steps": found.outcomes.track.steps.tolist(),
        "energy": found.outcomes.track.least.tolist(),
        "kind": found.ends.kind.tolist(),
    }


if __name__ == "__main__":
    coordinator, processes, process, out = sys.argv[1:]
    if int(processes) > 1:
        join_processes(coordinator, int(processes), int(process))
    result = run(16)
    if jax.process_index() == 0:
        with open(out, "w") as file:
            json.dump(result, file)
