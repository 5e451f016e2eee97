"""What one evaluation of a whole policy costs: called from Python as a control loop would, and in a batch."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ._plots import bars
from ._policies import Policy, on_device, panda_24_pairs, policies, states
from ._timing import call_times, quantiles

CALLS, BATCH, BATCH_CALLS = 100_000, 1024, 50


def rows(quick: bool = False) -> list[dict[str, Any]]:
    """One row a policy, in float32, and what a call costs that computes nothing.

    A call is what a control loop sees: state and what moves (goals, obstacles, the object) as NumPy arrays of float32,
    another state every time, and the result back as one. `whole_tree_us`: the median with all parameters of the tree
    as arguments, so that gains may change, too, on the device already; `fixed_us`: with nothing but the state.
    """
    calls = 200 if quick else CALLS
    found = [{"name": name, **_measured(policy, calls)} for name, policy in policies(quick).items()]
    policy = panda_24_pairs()
    for name, argument in (
        ("dispatch_of_state_alone", ()),
        ("dispatch_with_what_moves", policy.moving),
        ("dispatch_with_whole_tree", on_device(policy.tree_of(policy.moving))),
    ):
        floor = jax.jit(lambda given, q, qd: q + qd, keep_unused=True)
        found.append({"name": name, "arguments": len(jax.tree.leaves(argument)), **_calls(floor, argument, calls)})
    return found


def figure(found: list[dict[str, Any]]) -> Any:
    """Median and p99.9 of a call."""
    return bars(found, ("median_us", "p99_us", "p999_us"), "microseconds a call")


def _measured(policy: Policy, calls: int) -> dict[str, float]:
    moving, tree = policy.moving, on_device(policy.tree_of(policy.moving))
    fixed = jax.jit(lambda _, q, qd: policy(moving, q, qd))
    many = jax.jit(jax.vmap(policy, in_axes=(None, 0, 0)))
    Q, QD = (jnp.asarray(a) for a in states(BATCH))
    held = on_device(moving)
    batch = call_times(lambda i: many(held, Q, QD).block_until_ready(), min(calls, BATCH_CALLS))
    return {
        "arguments": len(jax.tree.leaves(moving)),
        **_calls(jax.jit(policy), moving, calls),
        "whole_tree_us": _calls(jax.jit(policy.resolved), tree, calls // 5)["median_us"],
        "fixed_us": _calls(fixed, (), calls // 5)["median_us"],
        "batch_1024_us": float(np.median(batch)) / BATCH,
    }


def _calls(policy: Callable, tree: Any, calls: int) -> dict[str, float]:
    Q, QD = states(BATCH)
    return quantiles(call_times(lambda i: np.asarray(policy(tree, Q[i % BATCH], QD[i % BATCH])), calls))
