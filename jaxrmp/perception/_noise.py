"""What a depth camera makes of the truth: a Kinect's noise."""

from typing import Any

import numpy as np

from .._errors import ConfigurationError
from .._ranges import NonNegative, Positive, settings


@settings("depth_noise")
class DepthNoise:
    """The noise of a structured-light depth camera, by default of a Kinect.

    At a depth z, m, the standard deviation along the camera's axis is `least` + `grows` (z - `nearest_sigma`)^2
    (Nguyen, Izadi and Lovell 2012, the axial noise of surfaces that are not seen at grazing angles); then 1 / z is
    rounded to a multiple of `quantum`, 1/m, for such a camera measures disparities (an eighth of a pixel, 2.9 mm at 1 m
    and 11 mm at 2 m). In every frame a share of pixels, drawn between the two of `missing`, holds nothing, and all
    nearer than `nearest` or beyond `farthest`, m.

    **Raises** `ConfigurationError` for a value that makes no sense.
    """

    least: NonNegative[float] = 0.0012
    grows: NonNegative[float] = 0.0019
    nearest_sigma: NonNegative[float] = 0.4
    quantum: NonNegative[float] = 0.00287
    missing: NonNegative[tuple[float, float]] = (0.1, 0.3)
    nearest: NonNegative[float] = 0.4
    farthest: Positive[float] = 8.0

    def __post_init__(self):
        if len(self.missing) != 2 or not self.missing[0] <= self.missing[1] <= 1:
            raise ConfigurationError(f"depth_noise.missing is {self.missing!r}, expected two shares, the lesser first.")


KINECT = DepthNoise()
PERFECT_DEPTH = DepthNoise(least=0.0, grows=0.0, quantum=0.0, missing=(0.0, 0.0), nearest=0.0, farthest=1e3)
"""A camera without noise."""


def axial_sigma(noise: DepthNoise, z: Any) -> Any:
    """The standard deviation, m, of a measured depth about the true one, `z`, m, by its `noise`, rounding included."""
    rounding = noise.quantum * z * z / 12**0.5
    return ((noise.least + noise.grows * (z - noise.nearest_sigma) ** 2) ** 2 + rounding**2) ** 0.5


def measured_depth(noise: DepthNoise, depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """What a camera measures of the true `depth` [height, width], m; 0 where it measures nothing.

    By its `noise`, in single precision; all chance from `rng`.
    """
    z = np.asarray(depth, np.float32)
    sigma = noise.least + noise.grows * (z - noise.nearest_sigma) ** 2
    found = z + sigma * rng.standard_normal(z.shape, np.float32)
    if noise.quantum:
        steps = np.round(1 / (noise.quantum * np.maximum(found, 1e-3)))
        found = 1 / (noise.quantum * np.maximum(steps, 1))
    gone = rng.random(z.shape, np.float32) < rng.uniform(*noise.missing)
    gone |= (z < noise.nearest) | (z > noise.farthest)
    return np.where(gone, 0, found).astype(np.float32)
