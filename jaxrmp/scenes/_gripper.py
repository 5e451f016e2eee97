"""The fingers of a scene: what moves them, and how wide they are for which control."""

from typing import NamedTuple

from .._errors import ConfigurationError

Width = str | float
"""What fingers are told: "open", "close", or how far apart they are to be, m."""


class Gripper(NamedTuple):
    """What moves the fingers of a scene's arm.

    `actuators`, by name, of MuJoCo's position kind or alike, which all get one control: `closed` where the fingers
    meet, `open` where they are `widest` apart, m, and evenly between. `joints`, by name, that these move, if the arm
    has them locked: it plans with the fingers where they are locked.
    """

    actuators: tuple[str, ...]
    widest: float
    open: float
    closed: float = 0.0
    joints: tuple[str, ...] = ()

    def control(self, width: Width) -> float:
        """The control for fingers that are "open", "close", or `width` apart, m. **Raises** as `check_width`, and
        `ConfigurationError` for a width beyond `widest`."""
        check_width(width)
        if not isinstance(width, str) and width > self.widest:
            raise ConfigurationError(f"gripper is {width!r}, expected at most {self.widest:g} m, which is all open.")
        share = {"open": 1.0, "close": 0.0}[width] if isinstance(width, str) else width / self.widest
        return self.closed + share * (self.open - self.closed)


def check_width(width: Width) -> None:
    """**Raises** `ConfigurationError` unless `width` is "open", "close" or a width in m."""
    number = isinstance(width, int | float) and not isinstance(width, bool) and 0 <= width < float("inf")
    if width not in ("open", "close") and not number:
        raise ConfigurationError(f'gripper is {width!r}, expected "open", "close" or a width, m.')
