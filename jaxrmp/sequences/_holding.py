"""Why a state has not arrived, in words: which leaves hold the arm off where it rests."""

from typing import Any

import jax
import numpy as np

from .._tree import Node
from ..inspection import goals, inspect
from ._advance import Memory, Observation
from ._sequence import Arrived, State

_LEAST = 0.02  # of all forces, below which a leaf is not told
_MOST = 3  # leaves that are told


def told_why(ahead: Memory, state: State, seen: Observation, tree: Node, q: Any) -> Memory:
    """The memory `ahead` of a sequence that failed in a `state`; if it failed to arrive, at what was `seen`, with why,
    by its policy's `tree` at `q` [n]."""
    if not isinstance(state.guard, Arrived):
        return ahead
    if seen.speed > state.guard.speed:
        return ahead._replace(reason=f"{ahead.reason}; the arm still moves there: give it a longer timeout")
    return ahead._replace(reason=f"{ahead.reason}; the arm came to rest there: {_held_by(tree, q)}")


def _held_by(tree: Node, q: Any) -> str:
    """The leaves without a goal that push most at rest at `q` [n], with their shares of all forces."""
    found = jax.jit(inspect)(tree, q, np.zeros_like(q))
    aims, shares = {_leaf(name) for name in goals(tree, q).names}, {}
    for name, share in zip(map(_leaf, found.names), np.asarray(found.force_share), strict=True):
        shares[name] = shares.get(name, 0.0) + float(share)
    others = sorted((name for name in shares if name not in aims and shares[name] >= _LEAST), key=lambda n: -shares[n])
    if not others:
        return "no other leaf holds the arm off, so it is out of reach, or something stands in its way"
    named = ", ".join(f"{name!r} ({100 * shares[name]:.0f} % of all forces)" for name in others[:_MOST])
    return f"other leaves hold the arm off, {named}"


def _leaf(name: str) -> str:
    """The leaf of a row of the inspector's, which may be one point of it."""
    return name.partition("[")[0]
