"""How far an evaluation of the 24-pair policy is from what one core of this machine could do at best."""

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp.xla._switch import one_kernel

from ._operations import bytes_needed, counted
from ._plots import bars
from ._policies import on_device, panda_24_pairs, states
from ._timing import alternately

BATCH = 1024
_LENGTH = 4096  # numbers, which stay in the first cache
_STEPS = 64


def rows(quick: bool = False) -> list[dict[str, Any]]:
    """The machine's peaks, measured; operations counted by hand and by the compiler; and the time that they would need.

    `limit_us` is the larger of operations over peak and bytes over bandwidth. The peak counts a fused multiply-add as
    two operations; a special operation counts as many as the peak does in the time that one takes (row of `special`).
    `times_limit` is what a batch of 1,024 takes an evaluation over that.
    """
    peaks = _peaks(quick)
    policy = panda_24_pairs()
    moving = on_device(policy.moving)
    Q, QD = (jnp.asarray(a) for a in states(BATCH))
    many = jax.vmap(policy, in_axes=(None, 0, 0))
    program = jax.jit(many).lower(moving, Q, QD).compile()
    with one_kernel():  # without C, of which XLA counts nothing
        by_xla = jax.jit(many).lower(moving, Q, QD).compile()
    calls = {
        "batch": lambda: program(moving, Q, QD).block_until_ready(),
        "by XLA": lambda: by_xla(moving, Q, QD).block_until_ready(),
    }
    taken = alternately(calls, rounds=2 if quick else 31, least=0.0 if quick else 0.05)
    measured, measured_by_xla = (float(np.median(taken[name])) / BATCH for name in calls)
    found = [{"name": f"peak, {name}", "value": value, "unit": unit} for name, value, unit in peaks.values()]
    parts = counted()
    found += [{"name": f"by hand, {name}", "operations": ops, "special": special} for name, ops, special in parts]
    total, special = sum(p[1] for p in parts), sum(p[2] for p in parts)
    found.append(_against("by hand", total, special, bytes_needed(), measured, peaks))
    cost: Any = by_xla.cost_analysis() or {}
    if "flops" in cost:
        compiled = (cost["flops"] / BATCH, cost.get("transcendentals", 0.0) / BATCH, cost["bytes accessed"] / BATCH)
        found.append(_against("as compiled by XLA", *compiled, measured_by_xla, peaks))
    return found


def figure(found: list[dict[str, Any]]) -> Any:
    """What is counted by hand, part by part."""
    return bars([row for row in found if row["name"].startswith("by hand,")], ("operations", "special"), "operations")


def _against(name: str, operations: float, special: float, size: float, us: float, peaks: dict) -> dict[str, Any]:
    work = operations + special * peaks["special"][1]
    by_operations, by_bytes = work / (1e3 * peaks["operations"][1]), size / (1e3 * peaks["bytes"][1])
    limit = max(by_operations, by_bytes)
    return {
        "name": f"{name}, all",
        "operations": operations,
        "special": special,
        "bytes": size,
        "operations_us": by_operations,
        "bytes_us": by_bytes,
        "limit_us": limit,
        "measured_us": us,
        "times_limit": us / limit,
    }


def _peaks(quick: bool) -> dict[str, tuple[str, float, str]]:
    """Multiply-adds, special operations in units of those, and bytes of a copy, each at its best of several turns."""
    repeats = 2 if quick else 20
    size = 256 if quick else 1024
    A = jnp.ones((size, size), jnp.float32)
    product = _best(jax.jit(lambda A: A @ A), A, repeats)
    if jax.default_backend() == "cpu":
        product = min(product, _best(lambda A: A @ A, np.ones((size, size), np.float32), repeats))
    x = jnp.linspace(0.1, 0.9, _LENGTH, dtype=jnp.float32)
    chain = _best(jax.jit(_four_chains), x, repeats)
    operations = max(2 * size**3 / product, 8 * _STEPS * _LENGTH / chain) / 1e9
    special = {
        name: _best(jax.jit(lambda x, f=f: _repeated(f, x)), x, repeats) / (_STEPS * _LENGTH)
        for name, f in (
            ("divide", lambda x: 0.3 / x),
            ("sqrt", jnp.sqrt),
            ("exp", lambda x: jnp.exp(-x)),
            ("sin", jnp.sin),
        )
    }
    mean = float(np.mean(list(special.values()))) * operations * 1e9
    large = jnp.zeros((1 if quick else 64) * 2**20, jnp.float32)
    copied = 2 * large.nbytes / _best(jax.jit(lambda a: a + 1), large, repeats) / 1e9
    return {
        "operations": ("float32 operations", operations, "Gop/s"),
        "special": ("a special operation (divide, sqrt, exp, sin: mean)", mean, "operations"),
        "bytes": ("reading and writing", copied, "GB/s"),
    }


def _four_chains(x: jax.Array) -> jax.Array:
    chains = [x, x + 1, x + 2, x + 3]
    for _ in range(_STEPS):
        chains = [c * 0.999 + 0.001 for c in chains]
    return sum(chains)  # type: ignore[return-value]


def _repeated(function: Callable, x: jax.Array) -> jax.Array:
    return jax.lax.fori_loop(0, _STEPS, lambda _, x: function(x), x)


def _best(function: Callable, argument: Any, repeats: int) -> float:
    """The least seconds of a call, over turns of a hundredth of a second."""
    jax.block_until_ready(function(argument))
    least = float("inf")
    for _ in range(repeats):
        start = time.perf_counter()
        count = 0
        while time.perf_counter() - start < 0.01:
            jax.block_until_ready(function(argument))
            count += 1
        least = min(least, (time.perf_counter() - start) / max(count, 1))
    return least
