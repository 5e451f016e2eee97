"""Policies in other languages: as C that a controller compiles, with nothing of ours or of JAX's beside it."""

from ._c_source import CSource as CSource
from ._c_source import c as c
from ._project import write_project as write_project
