"""What one evaluation of a whole policy costs: called from Python as a control loop would, and in a batch."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ._plots import bars
from ._policies import policies, states
from ._timing import call_times, quantiles

CALLS, BATCH, BATCH_CALLS = 100_000, 1024, 50


def rows(quick: bool = False) -> list[dict[str, Any]]:
    """One row a policy, in float32, and what a call costs that computes nothing.

    A call is what a control loop sees: another state every time, as NumPy arrays of float32, and the result back as
    one. The policy's tree is an argument, so that goals and obstacles may move; `fixed_tree_us`: compiled in.
    """
    calls = 200 if quick else CALLS
    found = []
    trees = policies(quick)
    for name, (tree, evaluate) in trees.items():
        found.append({"name": name, "parameters": len(jax.tree.leaves(tree)), **_measured(tree, evaluate, calls)})
    tree = trees["panda_24_pairs"][0]
    for name, argument in (("dispatch_of_state_alone", ()), ("dispatch_with_24_pair_tree", tree)):
        floor = jax.jit(lambda tree, q, qd: q + qd)
        found.append({"name": name, "parameters": len(jax.tree.leaves(argument)), **_calls(floor, argument, calls)})
    return found


def figure(found: list[dict[str, Any]]) -> Any:
    """Median and p99.9 of a call."""
    return bars(found, ("median_us", "p99_us", "p999_us"), "microseconds a call")


def _measured(tree: Any, evaluate: Callable, calls: int) -> dict[str, float]:
    one = jax.jit(evaluate)
    closed = jax.jit(lambda _, q, qd: evaluate(tree, q, qd))
    many = jax.jit(jax.vmap(evaluate, in_axes=(None, 0, 0)))
    Q, QD = (jnp.asarray(a) for a in states(BATCH))
    batch = call_times(lambda i: many(tree, Q, QD).block_until_ready(), min(calls, BATCH_CALLS))
    return {
        **_calls(one, tree, calls),
        "fixed_tree_us": _calls(closed, (), calls // 5)["median_us"],
        "batch_1024_us": float(np.median(batch)) / BATCH,
    }


def _calls(policy: Callable, tree: Any, calls: int) -> dict[str, float]:
    Q, QD = states(BATCH)
    return quantiles(call_times(lambda i: np.asarray(policy(tree, Q[i % BATCH], QD[i % BATCH])), calls))
