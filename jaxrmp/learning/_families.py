"""Demonstrations that disagree: families that start alike, end alike and part on the way, and odd ones out."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from .._errors import ShapeError, importing
from ._arc_length import resample_by_arc_length

_SAMPLES = 60  # along each path
_PART = 0.1  # of the paths' length: people part by less (see `families`)
_FAR = 0.15  # of it: any two that part by this are told
_SHOWN = 4  # pairs, in words
_RATIO = 1.5  # by how much more demonstrations part from another family than from their own
_AT_ONCE = 500  # pairs
_SHAPE = 0.3  # weight of the shape beside the parting where starts are too far apart to part


@dataclass(frozen=True)
class Parting:
    """Where demonstration `second` parts from `first`: they are `near` to each other, m, at the fraction `near_at` of
    the first's path, and later `apart`, m, at `at`. `turned` where it is the hand's turn that parts them more than its
    place. Distances are root mean squares over the control points, with the ends put together."""

    first: int
    second: int
    near: float
    near_at: float
    apart: float
    at: float
    turned: bool

    def __str__(self) -> str:
        """The same in words, in centimetres."""
        return (
            f"{self.first} and {self.second} are {100 * self.near:.1f} cm apart at {self.near_at:.0%} of the way and "
            f"{100 * self.apart:.1f} cm at {self.at:.0%}{', by how the hand is turned' * self.turned}"
        )


@dataclass(frozen=True)
class Families:
    """How N demonstrations agree, as indices of them.

    `groups`, the families of two or more, largest first: one of all N where there is but one; `odd`, those that are
    like no other; `parting`, between any two of these the pair that parts most, and pairs within one that part by far,
    the farthest first; `within`, m, by how much those of one group part at most; `length`, m, of the paths, the median;
    `certain`, unless the starts within a group lie farther apart than the groups part, or some of one group part by
    far: which go together is a guess then.
    """

    groups: tuple[tuple[int, ...], ...]
    odd: tuple[int, ...]
    parting: tuple[Parting, ...]
    within: float
    length: float
    certain: bool

    @property
    def agree(self) -> bool:
        """Whether none part."""
        return not self.parting

    def __str__(self) -> str:
        """What disagrees, where, by how much, and what to do."""
        if self.agree:
            return "all demonstrations go one way."
        several = len(self.groups) + len(self.odd) > 1
        ways = [*(", ".join(map(str, group)) for group in self.groups), *map(str, self.odd)]
        more = len(self.parting) - _SHOWN
        said = ["; ".join(map(str, self.parting[:_SHOWN])) + (f"; and {more} more pairs." if more > 0 else ".")]
        if several:
            said.append(f"Those of one group part by {100 * self.within:.1f} cm at most.")
        said.append("One skill would learn what lies between.")
        if not several:
            said.append("Leave out what is not meant, or learn them apart.")
        elif not self.certain:
            said.append("Which go together is a guess: put those that do into a folder each.")
        elif len(self.groups) > 1:
            said.append("Learn one of each group: jaxrmp learn --groups.")
        if self.odd:
            said.append(f"Like no other: {', '.join(map(str, self.odd))}. Leave out, or record more of the kind.")
        return f"demonstrations {f'go {len(ways)} ways: ' + ' | '.join(ways) if several else 'part'}. {' '.join(said)}"


def families(points: Sequence[np.ndarray]) -> Families:
    """Find the families of demonstrations that start alike, end alike and go different ways in between.

    Paths of all control points together, evenly in arc length, ends put together, are aligned in pairs by dynamic time
    warping. Two of them part by the largest rise of their distance g along the way, `max_b (g_b - min_{a <= b} g_a)`:
    paths that start decimetres apart and come together do not part at all; for those that part one field of motion is
    bound to go between. Groups are found by average linkage on the parting, with 0.3 of the difference in shape (as
    if both had one start) for those that start too far apart to part: the fewest of which each has a typical member
    (the median) that parts from another group by more than a tenth of the paths' length, and by 1.5 times as much as
    any two of one group. Groups are searched again. Two of one group that part by 0.15 of the length are told as well.

    The tenth is measured. Of 2,185 subsets of two to nine of recordings that go one way (drawer, door, a cup, poses,
    handwriting; and scripted ones) none is split or told: the nearest comes to 0.088, whole folders to 0.067, and the
    two that part most to 0.10. Handwriting that goes two ways comes to 0.18 and more, a cup reached round a box and
    straight to 0.17 (joints' line) and 0.32. The guide to demonstrations says what is found of planted families.

    **Arguments**: `points`, N arrays [T, K, m] of K control points, m, in the frame of the object or the goal, such as
    `PreparedDemonstrations.points`; with points that are not in line the hand's turn counts, by their distance.
    **Returns** `Families`; a single demonstration, and paths without length, agree.
    **Raises** `ShapeError` if the shapes do not fit together; `MissingDependencyError` without scipy.

    Rabiner and Juang 1993 for the alignment; Sokal and Michener 1958 for the linkage.
    """
    shapes = [np.shape(path) for path in points]
    if not shapes or any(len(shape) != 3 or 0 in shape or shape[1:] != shapes[0][1:] for shape in shapes):
        raise ShapeError(f"control points have shapes {shapes}, expected [T, K, m] with one K and m.")
    paths = np.stack([resample_by_arc_length(path, _SAMPLES) for path in points])
    paths = (paths - paths[:, -1:]) / np.sqrt(paths.shape[2])  # distances become root mean squares over the points
    N, flat = len(paths), paths.reshape(len(paths), _SAMPLES, -1)
    length = float(np.median(np.linalg.norm(np.diff(flat, axis=1), axis=-1).sum(axis=1)))
    everything = tuple(range(N))
    if N == 1:
        return Families((everything,), (), (), 0.0, length, True)
    pairs = list(combinations(everything, 2))
    found = [parting for k in range(0, len(pairs), _AT_ONCE) for parting in _partings(paths, pairs[k : k + _AT_ONCE])]
    shapes = flat - flat[:, :1] * np.linspace(1, 0, _SAMPLES)[:, None]  # as if all had one start
    parts, differ = np.zeros((N, N)), np.zeros((N, N))
    for p in found:
        i, j = p.first, p.second
        parts[i, j] = parts[j, i] = p.apart - p.near
        differ[i, j] = differ[j, i] = np.linalg.norm(shapes[i] - shapes[j], axis=-1).max()
    split = _split(everything, parts, differ, _PART * length)
    split.sort(key=lambda group: (-len(group), group))
    of = {n: g for g, group in enumerate(split) for n in group}
    found.sort(key=lambda p: p.near - p.apart)
    between: dict[tuple[int, ...], Parting] = {}
    for p in found:
        if of[p.first] != of[p.second]:
            between.setdefault(tuple(sorted((of[p.first], of[p.second]))), p)
    inside = [p for p in found if of[p.first] == of[p.second] and p.apart - p.near > _FAR * length]
    several = len(split) > 1
    farthest = [max(p.apart - p.near for two, p in between.items() if g in two) for g in range(len(split)) if several]
    starts = np.linalg.norm(flat[:, None, 0] - flat[None, :, 0], axis=-1)
    spread = max(_linkage(starts[np.ix_(group, group)], "single")[:, 2].max(initial=0.0) for group in split)
    return Families(
        groups=tuple(group for group in split if len(group) > 1 or not several),
        odd=tuple(group[0] for group in split if len(group) == 1 and several),
        parting=tuple(sorted([*between.values(), *inside], key=lambda p: p.near - p.apart)),
        within=max(float(parts[np.ix_(group, group)].max()) for group in split),
        length=length,
        certain=not inside and bool(spread <= min(farthest, default=np.inf)),
    )


def _partings(paths: np.ndarray, pairs: Sequence[tuple[int, int]]) -> list[Parting]:
    """Where the two of each pair of `paths` [N, S, K, m] part most, along their alignments."""
    i, j = np.transpose(pairs)
    first, second = (paths[n].reshape(len(pairs), _SAMPLES, -1) for n in (i, j))
    square = (first**2).sum(-1)[:, :, None] + (second**2).sum(-1)[:, None] - 2 * first @ second.swapaxes(1, 2)
    at, other = _alignments(np.sqrt(np.maximum(square, 0)))
    pair = np.arange(len(pairs))
    offsets = paths[i[:, None], at] - paths[j[:, None], other]  # [P, A, K, m]
    distance = np.sqrt((offsets**2).sum((-1, -2)))
    apart = (distance - np.minimum.accumulate(distance, axis=1)).argmax(axis=1)
    near = np.array([d[: b + 1].argmin() for d, b in zip(distance, apart, strict=True)])
    place = np.sqrt((offsets[pair, apart].sum(-2) ** 2).sum(-1) / paths.shape[2])  # of the points' middle
    length = _SAMPLES - 1
    return [
        Parting(
            *(int(i[p]), int(j[p])),
            *(float(distance[p, near[p]]), float(at[p, near[p]] / length)),
            *(float(distance[p, apart[p]]), float(at[p, apart[p]] / length)),
            turned=bool(place[p] < distance[p, apart[p]] / 2**0.5),
        )
        for p in pair
    ]


def _alignments(distance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The samples of both paths along the alignment with the least sum of `distance` [P, S, S], both [P, 2 S - 1];
    alignments that are shorter wait at the start."""
    P, S, _ = distance.shape
    total = np.full((P, S + 1, S + 1), np.inf)
    total[:, 0, 0] = 0
    for a in range(S):
        for b in range(S):
            before = np.minimum(np.minimum(total[:, a, b], total[:, a, b + 1]), total[:, a + 1, b])
            total[:, a + 1, b + 1] = distance[:, a, b] + before
    pair, a, b = np.arange(P), np.full(P, S), np.full(P, S)
    steps = [(a, b)]
    for _ in range(2 * S - 2):
        before = np.stack([total[pair, a - 1, b - 1], total[pair, a - 1, b], total[pair, a, b - 1]])
        step = before.argmin(axis=0)
        a, b = np.maximum(a - (step != 2), 1), np.maximum(b - (step != 1), 1)
        steps.append((a, b))
    along = np.array(steps[::-1]) - 1
    return along[:, 0].T, along[:, 1].T


def _split(group: tuple[int, ...], parts: np.ndarray, differ: np.ndarray, least: float) -> list[tuple[int, ...]]:
    """The fewest groups of `group` that part from each other and not as much in themselves, each split again; two alone
    say nothing of what is usual."""
    if len(group) < 3:
        return [group]
    members, part = np.array(group), parts[np.ix_(group, group)]
    tree = _linkage(part + _SHAPE * differ[np.ix_(group, group)], "average")
    for k in range(2, len(group) + 1):
        label = _cut(tree, k)
        same = label[:, None] == label
        outside = np.where(same, 0, part).max(axis=1)
        typical = min(np.median(outside[label == g]) for g in label)
        if typical > least and typical >= _RATIO * np.where(same, part, 0).max():
            found = [tuple(members[label == g].tolist()) for g in np.unique(label)]
            return [g for one in found for g in _split(one, parts, differ, least)]
    return [group]


def _linkage(distance: np.ndarray, method: str) -> np.ndarray:
    """The tree in which members at `distance` [N, N] are joined, [N - 1, 4]; for a single one it has no row."""
    with importing("scipy", "learning"):
        from scipy.cluster.hierarchy import linkage
        from scipy.spatial.distance import squareform
    return linkage(squareform(distance, checks=False), method) if len(distance) > 1 else np.zeros((0, 4))


def _cut(tree: np.ndarray, groups: int) -> np.ndarray:
    from scipy.cluster.hierarchy import fcluster

    return fcluster(tree, groups, "maxclust")
