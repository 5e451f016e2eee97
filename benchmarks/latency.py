"""What one evaluation of a whole policy costs: called from Python as a control loop would, and in a batch."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp import compiled

from ._plots import bars
from ._policies import Policy, on_device, panda_24_pairs, policies, states
from ._timing import call_times, quantiles

CALLS, BATCH, BATCH_CALLS = 100_000, 1024, 50


def rows(quick: bool = False) -> list[dict[str, Any]]:
    """One row a policy, in float32, and what a call costs that computes nothing.

    A call is what a control loop sees: state and what moves (goals, obstacles, the object) as NumPy arrays of float32,
    another state every time, and the result back as one, by `jaxrmp.compiled`. `jit_us`: the median by `jax.jit`
    instead. `whole_tree_us`: the median with all parameters of the tree as arguments, so that gains may change, too, on
    the device already; `fixed_us`: with nothing but the state.
    """
    calls = 200 if quick else CALLS
    found = [{"name": name, **_measured(policy, calls)} for name, policy in policies(quick).items()]
    policy = panda_24_pairs()
    for name, argument in (
        ("dispatch_of_state_alone", ()),
        ("dispatch_with_what_moves", policy.moving),
        ("dispatch_with_whole_tree", on_device(policy.tree_of(policy.moving))),
    ):
        found.append({"name": name, **_calls(_nothing, argument, calls), **_by_jit(_nothing, argument, calls)})
    return found


def figure(found: list[dict[str, Any]]) -> Any:
    """Median and p99.9 of a call."""
    return bars(found, ("median_us", "p99_us", "p999_us"), "microseconds a call")


def _measured(policy: Policy, calls: int) -> dict[str, float]:
    moving, tree = policy.moving, on_device(policy.tree_of(policy.moving))
    many = jax.jit(jax.vmap(policy, in_axes=(None, 0, 0)))
    Q, QD = (jnp.asarray(a) for a in states(BATCH))
    held = on_device(moving)
    batch = call_times(lambda i: many(held, Q, QD).block_until_ready(), min(calls, BATCH_CALLS))
    return {
        **_calls(policy, moving, calls),
        **_by_jit(policy, moving, calls),
        "whole_tree_us": _calls(policy.resolved, tree, calls // 5)["median_us"],
        "fixed_us": _calls(lambda _, q, qd: policy(moving, q, qd), (), calls // 5)["median_us"],
        "batch_1024_us": float(np.median(batch)) / BATCH,
    }


def _calls(policy: Callable, argument: Any, calls: int) -> dict[str, float]:
    Q, QD = states(BATCH)
    call = compiled(policy, argument, Q[0], QD[0])
    taken = quantiles(call_times(lambda i: call(argument, Q[i % BATCH], QD[i % BATCH]), calls))
    return {"arguments": len(jax.tree.leaves(argument)), **taken}


def _by_jit(policy: Callable, argument: Any, calls: int) -> dict[str, float]:
    Q, QD = states(BATCH)
    call = jax.jit(policy, keep_unused=True)
    taken = call_times(lambda i: np.asarray(call(argument, Q[i % BATCH], QD[i % BATCH])), calls // 5)
    return {"jit_us": quantiles(taken)["median_us"]}


def _nothing(given: Any, q: jax.Array, qd: jax.Array) -> jax.Array:
    return q + qd
