"""What is told of a run's depth camera: where it stood, and how well it saw the object."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any


def camera_in_words(report: Mapping[str, Any]) -> str:
    """Where the camera of a run stood and what it saw; `report` is what `run --json` writes."""
    camera = report["camera"]
    at, target = (", ".join(f"{x:.2f}" for x in camera[name]) for name in ("at_m", "looks_at_m"))
    seen = seen_in_words([trial["tracking"] for trial in report["per_trial"]])
    return (
        f"The policy knew of the object what a depth camera saw: {camera['width']} x {camera['height']} pixels with a "
        f"Kinect's noise, {camera['rate_hz']:g} images a second. It stood at ({at}) m and looked at ({target}) m, from "
        f"{camera['distance_m']:.2f} m away, {camera['above_deg']:.0f} degrees above. {seen[0].upper()}{seen[1:]}."
    )


def seen_in_words(seen: Sequence[Mapping[str, Any]]) -> str:
    """How a camera followed the object, in a line: `seen`, what it reports of each trial."""
    images, lost = (sum(each[name] for each in seen) for name in ("images", "lost"))
    position, angle = (_rms(seen, lambda each, name=name: each[name]) for name in ("position_m", "angle_deg"))
    joints = [f"{name} by {_rms(seen, lambda each, name=name: each['joints'][name]):.2g}" for name in seen[0]["joints"]]
    found = sum(math.isfinite(each["found_s"]) for each in seen)
    return (
        f"the camera found the object before {found} of {len(seen)} trials, and lost it in {lost} of {images} images; "
        f"RMS errors: {1000 * position:.1f} mm and {angle:.2f} degrees"
        + (f", of its joints (rad or m) {', '.join(joints)}" if joints else "")
    )


def _rms(seen: Sequence[Mapping[str, Any]], of: Callable[[Mapping[str, Any]], float]) -> float:
    """The root mean square over all images, of what `of` gives for each trial."""
    images = sum(each["images"] for each in seen)
    return math.sqrt(sum(each["images"] * of(each) ** 2 for each in seen) / max(images, 1))
