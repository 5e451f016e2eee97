"""In which order a program's nodes are computed, which of them by one loop, and where arrays are kept meanwhile."""

import heapq
from collections.abc import Sequence

import numpy as np

from ._c_nodes import INDEX, Node, Source, is_loop, sources_of, used_by


def needed(nodes: Sequence[Node], kept: set[int]) -> list[Node]:
    """The nodes, in their order, that sources to be `kept` are made of."""
    used = set(kept)
    for node in reversed(nodes):
        if node.out in used:
            used |= used_by(node)
    return [node for node in nodes if node.out in used]


def grouped(nodes: Sequence[Node]) -> list[list[Node]]:
    """The nodes in an order in which loops over one shape come together, those that become one as a list."""
    waiting: dict[int, int] = {}
    users: dict[int, list[Node]] = {}
    made = {n.out: n for n in nodes}
    order = {n.out: k for k, n in enumerate(nodes)}
    needs = {}
    for node in nodes:
        needs[node.out] = {s for s in used_by(node) if s in made}
        waiting[node.out] = len(needs[node.out])
        for s in needs[node.out]:
            users.setdefault(s, []).append(node)
    ready = [order[n.out] for n in nodes if not waiting[n.out]]  # a heap
    found: list[list[Node]] = []
    while ready:
        node = nodes[heapq.heappop(ready)]
        group, own = [], set()
        while node:
            group.append(node)
            own.add(node.out)
            for user in users.get(node.out, ()):
                waiting[user.out] -= 1
                if not waiting[user.out]:
                    heapq.heappush(ready, order[user.out])
            node = _next_of(group, own, nodes, ready) if is_loop(group[0]) else None
        found.append(group)
    return found


def _next_of(group: list[Node], own: set[int], nodes: Sequence[Node], ready: list[int]) -> Node | None:
    """The first that is ready and goes into the same loop, taken out of `ready`."""
    fits = [k for k in ready if nodes[k].shape == group[0].shape and _joins(nodes[k], own)]
    if not fits:
        return None
    ready.remove(min(fits))
    heapq.heapify(ready)
    return nodes[min(fits)]


def _joins(node: Node, own: set[int]) -> bool:
    """Whether what a node needs of a loop's own values is of the same entry."""
    return is_loop(node) and all(
        not sources_of(places) & own or np.array_equal(places & INDEX, np.arange(places.size).reshape(places.shape))
        for places in node.places
    )


def laid_out(
    sources: Sequence[Source], groups: Sequence[Sequence[Node]], kept: set[int], kinds: str = "fi"
) -> tuple[dict[int, int], int]:
    """Offsets of arrays of these `kinds`, so that those of one time are next to each other; how many entries."""
    last: dict[int, int] = {}
    for k, group in enumerate(groups):
        for node in group:
            for s in (*used_by(node), node.out):
                last[s] = k
    offsets: dict[int, int] = {}
    free: list[tuple[int, int]] = []
    size = 0
    ends: dict[int, list[int]] = {}
    for s, k in last.items():
        ends.setdefault(len(groups) if s in kept else k, []).append(s)
    for k, group in enumerate(groups):
        for node in group:
            source = sources[node.out]
            if (
                source.single
                or source.kind not in kinds
                or (is_loop(node) and last[node.out] == k and node.out not in kept)
            ):
                continue
            need = source.size
            fit = min((hole for hole in free if hole[1] >= need), key=lambda hole: hole[1], default=None)
            if fit:
                free.remove(fit)
                offsets[node.out] = fit[0]
                if fit[1] > need:
                    free.append((fit[0] + need, fit[1] - need))
            else:
                offsets[node.out] = size
                size += need
        for s in ends.get(k, ()):
            if s in offsets:
                free = _joined([*free, (offsets[s], sources[s].size)])
    return offsets, size


def _joined(holes: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Free ranges, neighbours as one."""
    found: list[tuple[int, int]] = []
    for start, size in sorted(holes):
        if found and sum(found[-1]) == start:
            found[-1] = (found[-1][0], found[-1][1] + size)
        else:
            found.append((start, size))
    return found
