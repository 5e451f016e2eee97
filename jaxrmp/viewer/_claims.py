"""What a page may claim of its policy, in words: that V falls, what is avoided, and what nobody checked."""

import numpy as np

from .._counted import counted

AVOIDS = {"to obstacles": "collision_avoidance", "to itself": "self_collision"}
"""Distances that a page shows, and the leaves that know them."""
_LOSES = {
    "to obstacles": "nothing keeps it off the obstacles on this page",
    "to itself": "nothing keeps the arm off itself",
}


def lacking(names: tuple[str, ...], wanted: tuple[str, ...]) -> tuple[str, ...]:
    """Those of the `wanted` distances, of `AVOIDS`, whose leaf is not among the `names` of a policy's."""
    return tuple(what for what in wanted if AVOIDS[what] not in names)


def banners(names: tuple[str, ...], offered: tuple[str, ...], spheres: bool) -> list[str]:
    """What to say at the top of a page that has things to keep off, the `offered` distances, of a policy with leaves of
    these `names`; `spheres`, whether its arm has any."""
    if not spheres:
        return ["The arm has no collision spheres: it avoids nothing, and distances are not checked."]
    missing = lacking(names, offered)
    return [f"The policy has no leaf {AVOIDS[what]}: {_LOSES[what]}. Not checked." for what in missing]


def avoidance_words(
    names: tuple[str, ...], wanted: tuple[str, ...], shares: np.ndarray, gains: dict[str, float], ignored: int
) -> str:
    """What of the `wanted` distances counts for nothing now: without a leaf, one that is switched off (`shares` [S], of
    the `names`), or with a gain of zero (`gains`, by leaf.parameter); and how many obstacles are `ignored`. Empty where
    all is as it should be."""
    said = []
    for what in wanted:
        leaf = AVOIDS[what]
        if leaf not in names:
            said.append(f"{what}: not checked")
        elif not shares[names.index(leaf)]:
            said.append(f"{leaf} is switched off: {_LOSES[what]}")
        elif gains.get(f"{leaf}.barrier", 1.0) == 0:
            said.append(f"{leaf} has a barrier of zero: {_LOSES[what]}")
    if ignored:
        said.append(f"{counted(ignored, 'obstacle')} not finite, ignored")
    return " · ".join(said)


def energy_words(uncertified: tuple[str, ...], energy: float, violations: int) -> str:
    """What is known of the energy V: whether every leaf has its certificate, and whether it rose by itself in frames so
    far, of which the last one ended at `energy`, NaN if none did."""
    if uncertified:
        state = f"not certified: {', '.join(uncertified)}"
    else:
        state = "certified: V may only fall (of collisions this says nothing)"
    if violations:
        return f"{state} · V rose, or was not a number, in {counted(violations, 'frame')}"
    return f"{state} · " + ("V has not risen by itself" if np.isfinite(energy) else "not checked yet")
