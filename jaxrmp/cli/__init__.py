"""The command line: `jaxrmp learn`, `jaxrmp reproduce`, `jaxrmp evaluate`, `jaxrmp demonstrate`."""

from ._main import main as main
from ._parser import build_parser as build_parser
