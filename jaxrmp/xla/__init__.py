"""How policies run fast on this hardware, behind one switch: nothing in here changes what a policy computes.

Mathematics is written as it is in the papers and says one word, `one_loop`, where it is small arithmetic that a batch
repeats. With `machinery(False)`, or `JAXRMP_XLA=off` in the environment, that word means nothing.
"""

from ._blocks import in_blocks as in_blocks
from ._c_fields import HIT as HIT
from ._c_fields import Field as Field
from ._c_fields import layout as layout
from ._c_fields import struct as struct
from ._c_single import Single as Single
from ._c_single import single_program as single_program
from ._c_while import require_count as require_count
from ._compiled import Compiled as Compiled
from ._compiled import compiled as compiled
from ._cores import own_cores as own_cores
from ._lanes import in_lanes as in_lanes
from ._materialise import concatenated as concatenated
from ._materialise import materialise as materialise
from ._not_scalar import NotScalar as NotScalar
from ._one_loop import one_loop as one_loop
from ._quickly import WITHOUT_EMITTERS as WITHOUT_EMITTERS
from ._quickly import known_options as known_options
from ._quickly import quickly as quickly
from ._report import Part as Part
from ._report import report as report
from ._switch import as_here as as_here
from ._switch import machinery as machinery
