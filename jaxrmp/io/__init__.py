"""Reading other tools' files."""

from ._lula import LulaPolicy as LulaPolicy
from ._lula import load_lula as load_lula
