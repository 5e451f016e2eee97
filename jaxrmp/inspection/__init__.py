"""Which leaf is doing that? Every leaf's part in what a tree does."""

from ._goals import Goals as Goals
from ._goals import goals as goals
from ._inspect import Inspection as Inspection
from ._inspect import inspect as inspect
from ._table import table as table
