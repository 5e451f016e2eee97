"""The command line: a module for each command, `jaxrmp COMMAND`."""

from ._main import main as main
from ._parser import build_parser as build_parser
