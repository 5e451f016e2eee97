"""Policies as files that other programs run."""

from ._stablehlo import load_stablehlo as load_stablehlo
from ._stablehlo import stablehlo as stablehlo
from ._stablehlo import write_stablehlo as write_stablehlo
