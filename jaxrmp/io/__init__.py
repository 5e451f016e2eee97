"""Reading other tools' files."""

from ._lula import LulaPolicy as LulaPolicy
from ._lula import load_lula as load_lula
from ._xrdf import Xrdf as Xrdf
from ._xrdf import read_xrdf as read_xrdf
