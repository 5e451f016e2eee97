"""One skill's training of its metrics, by us and in plain PyTorch: same data, same first weights, same updates."""

from dataclasses import asdict
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp.learning import load_skill, prepare, training_samples
from jaxrmp.learning._metric_network import initial_cholesky_factor
from jaxrmp.learning._metric_training import train_metrics
from jaxrmp.xla import own_cores

from ._skills import configuration, demonstrations, skill_file, source_here

AGREE = 1e-5


class Training(NamedTuple):
    """What `train_metrics` takes: `x`, `slope`, `velocity` [K, N, 3], and its settings."""

    x: jax.Array
    slope: jax.Array
    velocity: jax.Array
    settings: dict[str, Any]


def training_of(task: str, quick: bool) -> Training:
    """The training of a task's metrics, with the potentials and the support of its learned skill."""
    settings = configuration(task, quick)
    learned = load_skill(skill_file(task, quick=quick, method="paper")).learned
    assert learned is not None  # by the paper's method
    prepared = prepare(settings, settings.load_robot(), demonstrations(task, source_here(quick)))
    samples = training_samples(prepared.subtasks, settings.metric, settings.seed)
    x, velocity = (jnp.asarray(a, jnp.float32) for a in samples)
    slope = jax.jit(jax.vmap(lambda potential, x: jax.vmap(jax.grad(potential))(x)))(learned.potential_of, x)
    rest = asdict(settings.metric)
    for name in ("spread", "convergence", "reach"):
        del rest[name]
    support: Any = learned.cholesky_of  # a CholeskyFactor of the learning package
    return Training(x, slope, velocity, {**rest, "seed": settings.seed, "support": support.support})


def rows(quick: bool) -> list[dict[str, Any]]:
    """One row each: the loop's seconds by us, after compilation, and by PyTorch on one thread and on all cores.

    Turns alternate, and ratios are within a turn: what else the machine does hits all alike.
    **Raises** `RuntimeError` if the losses before the first update differ by more than 1e-5.
    """
    training = training_of("drawer_closing", quick)
    threads = sorted({1, own_cores()})
    names = ["jaxrmp", *(f"torch, threads: {count}" for count in threads)]
    seconds: dict[str, list[float]] = {name: [] for name in names}
    losses = {}
    for _ in range(1 if quick else 3):
        fit = train_metrics(*training[:3], **training.settings)
        losses["jaxrmp"] = fit.losses
        seconds["jaxrmp"].append(fit.loop_seconds)
        for name, count in zip(names[1:], threads, strict=True):
            losses[name], taken = in_torch(training, count)
            seconds[name].append(taken)
    for name in names[1:]:
        if (apart := float(np.abs(losses["jaxrmp"][0] - losses[name][0]).max())) > AGREE:
            raise RuntimeError(f"the losses before the first update differ by {apart:.1e}, more than {AGREE:.0e}.")
    return [
        {
            "name": f"metric loop, {name}",
            "updates": training.settings["updates"],
            "loop_s": float(np.median(seconds[name])),
            "times_ours": float(np.median(np.array(seconds[name]) / np.array(seconds["jaxrmp"]))),
            "first_loss": float(losses[name][0].mean()),
            "last_loss": float(losses[name][-1].mean()),
        }
        for name in names
    ]


def in_torch(training: Training, threads: int) -> tuple[np.ndarray, float]:
    """The same training by `_torch_learning.train`: losses [updates, K] and seconds."""
    import torch

    from ._torch_learning import CholeskyNetwork, Problem, train

    torch.set_num_threads(threads)
    s = training.settings
    keys = jax.random.split(jax.random.key(s["seed"]), len(training.x))
    networks, problems = [], []
    for k, key in enumerate(keys):
        first = initial_cholesky_factor(key, 3, s["hidden"], s["activation"], s["offset"], s["length_scale"])
        networks.append(CholeskyNetwork(first.weights, s["activation"], s["offset"], s["length_scale"]))
        support = jax.tree.map(lambda a, k=k: a[k], s["support"])
        weight = None if support is None else jax.vmap(support)(training.x[k])
        problems.append(Problem(training.x[k], training.slope[k], training.velocity[k], weight))
    return train(networks, problems, s["updates"], s["learning_rate"], s["weight_decay"])
