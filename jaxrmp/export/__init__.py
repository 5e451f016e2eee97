"""Policies as files that other programs run: C that a controller compiles, StableHLO where only jax is installed."""

from ._c_source import CSource as CSource
from ._c_source import c as c
from ._project import write_project as write_project
from ._stablehlo import load_stablehlo as load_stablehlo
from ._stablehlo import stablehlo as stablehlo
from ._stablehlo import write_stablehlo as write_stablehlo
