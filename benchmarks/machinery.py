"""What the machinery of `jaxrmp.xla` gains: the policy of 24 pairs with it and as written, by turns, in batches."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp import compiled
from jaxrmp.xla import machinery

from ._policies import Policy, on_device, panda_24_pairs, states
from ._timing import alternately, ratio

BATCHES = (1, 4, 16, 64, 128, 256, 1024)


def rows(quick: bool = False) -> list[dict[str, Any]]:
    """One row a batch, in float32; a batch of 1 is a call by `compiled`.

    `us_per_evaluation` with the machinery, `as_written_us` without; `times_as_written`, how many times as long the one
    takes as the other: the median over turns, each against its neighbour. It should nowhere be above one.
    """
    policy, found = panda_24_pairs(), []
    for batch in BATCHES[:2] if quick else BATCHES:
        calls = {}
        for name, on in (("on", True), ("off", False)):
            with machinery(on):
                calls[name] = _call(policy, batch)
        taken = alternately(calls, rounds=2 if quick else 31, least=0.0 if quick else 0.02)
        found.append(
            {
                "name": "panda_24_pairs",
                "batch": batch,
                "us_per_evaluation": float(np.median(taken["on"])) / batch,
                "as_written_us": float(np.median(taken["off"])) / batch,
                "times_as_written": ratio(taken["on"], taken["off"]),
            }
        )
    return found


def _call(policy: Policy, batch: int) -> Callable[[], Any]:
    Q, QD = states(batch)
    if batch == 1:
        one = compiled(policy, policy.moving, Q[0], QD[0])
        return lambda: one(policy.moving, Q[0], QD[0])
    arguments = on_device(policy.moving), jnp.asarray(Q), jnp.asarray(QD)
    many = jax.jit(jax.vmap(policy, in_axes=(None, 0, 0))).lower(*arguments).compile()
    return lambda: many(*arguments).block_until_ready()
