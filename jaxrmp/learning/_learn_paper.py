"""The paper's two steps: a potential of one demonstration for each control point, and metrics that warp them."""

from collections.abc import Callable
from dataclasses import asdict
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..leaves import Learned, NominalPotential
from ._configuration import Configuration, MetricSettings
from ._metric_training import MetricFit, train_metrics
from ._nominal import nominal_demonstration
from ._potential_choice import PotentialChoice, choose_potential
from ._subtask_trajectories import SubtaskTrajectories
from ._support import support_of_samples

Progress = Callable[[str, float], None]


class PaperLearning(NamedTuple):
    """Leaves `learned` of K subtasks, stacked, and how: K indices of the `nominal` demonstrations, K `potentials`, and
    the `metric` fit."""

    learned: Learned
    nominal: tuple[int, ...]
    potentials: tuple[PotentialChoice, ...]
    metric: MetricFit


def learn_paper(configuration: Configuration, subtasks: SubtaskTrajectories, progress: Progress) -> PaperLearning:
    """For each control point: the nominal demonstration, the one nearest to all others in DTW; a potential around it
    from a convex program, its kernel width chosen with the basin checked; then for all of them at once the metrics
    that warp the potentials' gradients until they reproduce every demonstration.

    **Arguments**: `configuration`, whose sections `potential` and `metric` count; `subtasks`, by `prepare`; `progress`,
    called with the name of a step and the fraction of it that is done. **Returns** a `PaperLearning`.
    **Raises** `ConvexProgramError`, `BasinError`, `TrainingError`, as its steps do.

    Rana et al. 2019, section 3.
    """
    nominal, potentials = [], []
    K = len(configuration.subtasks)
    for k, positions in enumerate(subtasks.positions):
        progress("potentials", k / K)
        nominal.append(nominal_demonstration(list(positions))[0])
        found = choose_potential(
            *(positions, subtasks.directions[k], nominal[-1]),
            seed=configuration.seed,
            progress=lambda fraction, k=k: progress("potentials", (k + fraction) / K),
            **asdict(configuration.potential),
        )
        potentials.append(found)
    progress("potentials", 1.0)
    potential = _stacked([choice.fit.potential for choice in potentials])
    metric = _train(configuration, subtasks, potential, progress)
    policy = configuration.policy
    gains = (jnp.full(K, gain, jnp.float32) for gain in (policy.speed, policy.damping_rate))
    return PaperLearning(Learned(potential, metric.factors, *gains), tuple(nominal), tuple(potentials), metric)


def training_samples(
    subtasks: SubtaskTrajectories, settings: MetricSettings, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """What the metrics are trained on: positions and target velocities, both [K, S, 3].

    Every second sample of every demonstration, and a copy of it displaced by normal noise of standard deviation
    `settings.spread` across the direction of motion, whose target velocity is turned back to the demonstration so far
    that it would arrive `settings.convergence` further on. The copies make the field converge in a tube around each
    demonstration: without them a rollout that drifts a little may be sent astray.

    **Arguments**: `subtasks`, of all demonstrations; `settings`, of the metric; `seed`, of the noise.
    """
    K = len(subtasks.positions)
    x, v = subtasks.positions[:, :, 1::2], subtasks.velocities[:, :, 1::2]
    along = subtasks.directions[:, :, 1::2]
    noise = np.random.default_rng(seed).normal(size=x.shape) * settings.spread
    noise -= (noise * along).sum(-1, keepdims=True) * along
    noise[np.linalg.norm(x, axis=-1) < settings.spread] = 0  # near the goal the target velocity is not parallel
    back = along - noise / settings.convergence
    back *= np.linalg.norm(v, axis=-1, keepdims=True) / np.linalg.norm(back, axis=-1, keepdims=True)
    pairs = [(x, v), (x + noise, back)]
    return tuple(np.concatenate([pair[i] for pair in pairs], axis=2).reshape(K, -1, 3) for i in range(2))  # type: ignore[return-value]


def _train(
    configuration: Configuration, subtasks: SubtaskTrajectories, potential: NominalPotential, progress: Progress
) -> MetricFit:
    samples = training_samples(subtasks, configuration.metric, configuration.seed)
    x, velocity = (jnp.asarray(a, jnp.float32) for a in samples)
    slope = jax.jit(jax.vmap(lambda potential, x: jax.vmap(jax.grad(potential))(x)))(potential, x)
    settings = asdict(configuration.metric)
    reach, *_ = (settings.pop(name) for name in ("reach", "spread", "convergence"))
    demonstrated = subtasks.positions[:, :, 1::4].reshape(len(x), -1, x.shape[-1])
    support = _stacked([support_of_samples(samples, reach) for samples in demonstrated]) if reach > 0 else None
    told = {"progress": lambda done, loss: progress("metrics", done / settings["updates"])}
    return train_metrics(x, slope, velocity, seed=configuration.seed, support=support, **told, **settings)


def _stacked(potentials: list[Any]) -> Any:
    """Several potentials as one with a leading axis, float32."""
    return jax.tree.map(lambda *a: jnp.stack([jnp.asarray(v, jnp.float32) for v in a]), *potentials)
