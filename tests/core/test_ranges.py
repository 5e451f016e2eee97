"""Ranges of numbers, declared with the field and checked as a value is made."""

from dataclasses import FrozenInstanceError, replace
from typing import Annotated

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, pytree, static
from jaxrmp._ranges import BelowOne, Finite, NonNegative, Positive, settings


@pytree
class Spring:
    stiffness: NonNegative[jax.Array | float] = 1.0
    length: Positive[Finite[jax.Array | float | None]] = None
    share: BelowOne[NonNegative[float]] = 0.5
    noted: Annotated[float, "not a range"] = -1.0
    name: str = static(default="spring")

    def __post_init__(self):
        if self.name == "refused":
            raise ValueError("its own check")


@pytree
class HeavySpring(Spring):
    mass: Positive[jax.Array | float] = 1.0


@settings("spring")
class SpringSettings:
    turns: Positive[int] = 3
    widths: Positive[tuple[float, ...]] = (0.1, 0.2)


@pytest.mark.parametrize("kind", [Spring, HeavySpring])
@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("stiffness", -1.0, "stiffness of {} is -1.0, expected a number that is not negative"),
        ("stiffness", np.nan, "stiffness of {} is nan, expected a number that is not negative"),
        ("stiffness", jnp.array([[1.0, 0.0], [2.0, -3.0]]), r"stiffness\[1, 1\] of {} is -3.0"),
        ("length", 0.0, "length of {} is 0.0, expected a positive number"),
        ("length", np.inf, "length of {} is inf, expected a finite number"),
        ("share", 1.0, "share of {} is 1.0, expected a number below one"),
        ("share", -0.1, "share of {} is -0.1, expected a number that is not negative"),
    ],
)
def test_a_number_outside_its_range_is_named(kind, name, value, says):
    with pytest.raises(ConfigurationError, match=says.format(kind.__name__)):
        kind(**{name: value})
    with pytest.raises(ConfigurationError, match=says.format(kind.__name__)):
        replace(kind(), **{name: value})


def test_what_is_in_range_passes_and_own_checks_come_after():
    assert Spring(stiffness=np.inf, length=2.0, share=0.0).noted == -1.0
    with pytest.raises(ConfigurationError, match="mass of HeavySpring"):
        HeavySpring(mass=0.0)
    with pytest.raises(ValueError, match="its own check"):
        HeavySpring(name="refused")
    with pytest.raises(ConfigurationError, match="share of Spring"):
        Spring(share=2.0, name="refused")


def test_placeholders_are_not_looked_at():
    slope = jax.jit(jax.grad(lambda value: Spring(stiffness=value).stiffness ** 2))
    assert slope(-3.0) == -6.0
    assert jax.tree.map(lambda a: -a, HeavySpring()).mass == -1.0


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"turns": 0}, "spring.turns is 0, expected a positive number"),
        ({"widths": (0.1, -0.2)}, r"spring.widths is \(0.1, -0.2\), expected a positive number"),
        ({"widths": ()}, r"spring.widths is \(\), expected a positive number"),
        ({"widths": (np.inf,)}, r"spring.widths is \(inf,\), expected a positive number"),
    ],
)
def test_settings_are_frozen_and_named_by_their_section(wrong, says):
    with pytest.raises(ConfigurationError, match=says):
        SpringSettings(**wrong)
    with pytest.raises(FrozenInstanceError):
        SpringSettings().turns = 4  # type: ignore[misc]
