"""A scripted demonstrator: synthetic stand-ins for recorded demonstrations, so that everything runs without data."""

from ._demonstrator import SYNTHETIC_TASKS as SYNTHETIC_TASKS
from ._demonstrator import synthetic_demonstrations as synthetic_demonstrations
from ._demonstrator import write_synthetic_demonstrations as write_synthetic_demonstrations
