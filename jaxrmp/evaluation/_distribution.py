"""Starts divided among processes, on one machine or several, and what they found gathered in every one."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from .._errors import ConfigurationError


def join_processes(coordinator: str, processes: int, process: int) -> None:
    """Make this process number `process` of `processes` that work together, before JAX is used.

    **Arguments**: `coordinator`, host:port on which process 0 listens; all processes give the same.
    **Raises** `ConfigurationError` if they do not find each other, or JAX has begun to work already.
    """
    if not 0 <= process < processes:
        raise ConfigurationError(f"process is {process}, expected 0 to {processes - 1}: one of {processes} processes.")
    try:
        jax.distributed.initialize(coordinator, processes, process, initialization_timeout=60)
    except (RuntimeError, ValueError) as error:
        raise ConfigurationError(
            f"process {process} of {processes} did not reach the others through {coordinator!r}: {error}"
        ) from error


def map_over_processes(work: Callable[[np.ndarray], Any], starts: np.ndarray) -> Any:
    """`work(starts)`, done by all processes on every P-th start each, the whole result in every one of them.

    **Arguments**: `work`, from starts [M, n] to a pytree of arrays [M, ...] in which row i belongs to start i; `starts`
    [N, n], the same in all processes. **Raises** `ConfigurationError` for fewer starts than processes.
    """
    P, me = jax.process_count(), jax.process_index()
    if P == 1:
        return work(starts)
    if len(starts) < P:
        raise ConfigurationError(f"{len(starts)} starts for {P} processes: use as many starts at least.")
    from jax.experimental.multihost_utils import process_allgather

    share = -(-len(starts) // P)
    own = starts[me::P]
    part = work(own)
    part = jax.tree.map(lambda a: np.concatenate([a, np.repeat(a[:1], share - len(own), axis=0)]), part)
    gathered = process_allgather(part)  # [P, share, ...]: row (p, i) is start p + i P
    return jax.tree.map(lambda a: np.swapaxes(np.asarray(a), 0, 1).reshape(-1, *a.shape[2:])[: len(starts)], gathered)
