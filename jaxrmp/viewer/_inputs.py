"""What a person can change on the page while the policy runs: gains and switches."""

import dataclasses
from typing import Any, NamedTuple

import jax
import numpy as np

_RANGE = 4.0  # sliders go from nothing, or near it, to this many times the gain at the start


class Gain(NamedTuple):
    """A number of a policy: `label`; `path`, the name of a leaf and of its parameter; whether it may be `zero`."""

    label: str
    path: str
    zero: bool = True


_KNOWN = (
    Gain("cruise speed (m/s)", "learned.speed", zero=False),
    Gain("path damping (1/s)", "learned.damping_rate", zero=False),
    Gain("goal pull (m/s²)", "hand_position.gain"),
    Gain("goal sharpness (1/m)", "hand_position.sharpness", zero=False),
    Gain("goal damping (1/s)", "hand_position.damping_rate"),
    Gain("turn weight", "hand_orientation.weight"),
    Gain("turn stiffness (1/s²)", "hand_orientation.stiffness"),
    Gain("posture stiffness (1/s²)", "posture.stiffness"),
    Gain("joint damping (1/s)", "joint_damping.damping_rate"),
    Gain("joint damping weight", "joint_damping.weight", zero=False),
    Gain("joint limit barrier", "joint_limit.barrier"),
    Gain("avoidance barrier", "collision_avoidance.barrier"),
    Gain("avoidance reach (m)", "collision_avoidance.reach", zero=False),
)


def gains_of(policy: Any) -> list[Gain]:
    """Those of the known gains that a policy has."""
    return [gain for gain in _KNOWN if _holders(policy, gain.path)]


def gain_value(policy: Any, path: str) -> float:
    """The value of a gain; the mean where each of several points has its own."""
    name = path.partition(".")[2]
    return float(np.mean([np.mean(getattr(leaf, name)) for leaf in _holders(policy, path)]))


def with_gain(policy: Any, path: str, value: Any) -> Any:
    """The same policy with a gain set, for all points alike, in whatever part of it the leaf is.

    **Raises** `KeyError` for a gain that it does not have.
    """
    name = path.partition(".")[2]
    if not _holders(policy, path):
        raise KeyError(path)

    def changed(part: Any) -> Any:
        if not _holds(part, path):
            return part
        return dataclasses.replace(part, **{name: np.full(np.shape(getattr(part, name)), value, np.float32)})

    return jax.tree.map(changed, policy, is_leaf=lambda part: _holds(part, path))


def _holders(policy: Any, path: str) -> list[Any]:
    parts = jax.tree.leaves(policy, is_leaf=lambda part: _holds(part, path))
    return [part for part in parts if _holds(part, path)]


def _holds(part: Any, path: str) -> bool:
    leaf, _, name = path.partition(".")
    return getattr(part, "name", None) == leaf and getattr(part, name, None) is not None


class GainSliders:
    """A slider for each known gain of a policy, and the policy as they stand."""

    def __init__(self, server: Any, policy: Any):
        self._policy = policy
        self._sliders = {}
        self._known = {gain.path: gain_value(policy, gain.path) for gain in gains_of(policy)}
        for gain in gains_of(policy):
            value = gain_value(policy, gain.path)
            if value <= 0:
                continue
            step = value / 50
            slider = server.gui.add_slider(
                gain.label,
                0.0 if gain.zero else step,
                _RANGE * value,
                step=step,
                initial_value=value,
                hint=gain.path,
            )
            self._sliders[gain.path] = (slider, value)
        self._last: tuple[float, ...] = tuple(value for _, value in self._sliders.values())
        self._current = policy
        if self._sliders:
            server.gui.add_button("As they were", icon="rotate").on_click(lambda _: self.reset())

    def read(self) -> Any:
        """The policy with the gains as the sliders stand; the same object until one moves."""
        values = tuple(float(slider.value) for slider, _ in self._sliders.values())
        if values != self._last:
            policy = self._policy
            for (path, (_, initial)), value in zip(self._sliders.items(), values, strict=True):
                if abs(value - initial) > 1e-6 * abs(initial):
                    policy = with_gain(policy, path, value)
            self._last, self._current = values, policy
        return self._current

    @property
    def values(self) -> dict[str, float]:
        """All gains that the policy has, by their paths, as they stand."""
        return self._known | {path: float(slider.value) for path, (slider, _) in self._sliders.items()}

    @property
    def changed(self) -> dict[str, float]:
        """Those that are not as they were at the start."""
        now = {path: (float(slider.value), value) for path, (slider, value) in self._sliders.items()}
        return {path: value for path, (value, initial) in now.items() if abs(value - initial) > 1e-6 * abs(initial)}

    def slider(self, path: str) -> Any:
        """The slider of a gain, given its path, leaf.parameter."""
        return self._sliders[path][0]

    def reset(self) -> None:
        """All sliders as they were at the start."""
        for slider, value in self._sliders.values():
            slider.value = value


class LeafSwitches:
    """A checkbox for each leaf, named as the inspector names it, the first ones with `hints`, and the shares that they
    stand for."""

    def __init__(self, server: Any, names: tuple[str, ...], hints: tuple[str, ...]):
        self.names = names
        more = (*hints, *[""] * (len(names) - len(hints)))
        self.boxes = [server.gui.add_checkbox(n, True, hint=h or None) for n, h in zip(names, more, strict=True)]

    def read(self) -> np.ndarray:
        """One or zero for each leaf, [S]."""
        return np.array([float(box.value) for box in self.boxes], np.float32)
