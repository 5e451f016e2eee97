"""How long calls take, as their caller sees them."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

QUANTILES = {"median": 0.5, "p99": 0.99, "p999": 0.999}


def call_times(call: Callable[[int], Any], count: int) -> np.ndarray:
    """Microseconds [count] of `call(i)`, which must wait for its own result; before, a tenth as many to warm up."""
    taken = np.empty(count)
    for i in range(-(count // 10), 0):
        call(i)
    for i in range(count):
        start = time.perf_counter_ns()
        call(i)
        taken[i] = time.perf_counter_ns() - start
    return taken / 1e3


def quantiles(microseconds: np.ndarray) -> dict[str, float]:
    """The columns `median_us`, `p99_us` and `p999_us`."""
    return {f"{label}_us": float(np.quantile(microseconds, p)) for label, p in QUANTILES.items()}


def alternately(calls: dict[str, Callable[[], Any]], rounds: int = 15, least: float = 0.05) -> dict[str, np.ndarray]:
    """Microseconds a call [rounds] of several calls, which take turns: what else the machine does hits all alike.

    A turn is as many calls as take `least` seconds, and at least one.
    """
    counts = {}
    for name, call in calls.items():
        call()
        start = time.perf_counter()
        call()
        counts[name] = max(1, round(least / (time.perf_counter() - start)))
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            start = time.perf_counter()
            for _ in range(counts[name]):
                call()
            taken[name].append(1e6 * (time.perf_counter() - start) / counts[name])
    return {name: np.array(values) for name, values in taken.items()}


def ratio(slower: np.ndarray, faster: np.ndarray) -> float:
    """How many times as long the one takes as the other: the median over turns, each against its neighbour."""
    return float(np.median(slower / faster))
