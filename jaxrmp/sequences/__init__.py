"""Policies one after the other, with the gripper between: states, each with its guard and its own certificate.

Within a state the energy of its policy falls, as its certificate says; from one state to the next it jumps, for another
policy has another energy. Both are reported of every run.
"""

from ._advance import Memory as Memory
from ._advance import Observation as Observation
from ._advance import Passed as Passed
from ._advance import advance as advance
from ._kinematic import SequencePath as SequencePath
from ._kinematic import roll_sequence as roll_sequence
from ._physics import SequenceRun as SequenceRun
from ._physics import run_sequence as run_sequence
from ._report import SequenceOutcome as SequenceOutcome
from ._report import StateReport as StateReport
from ._sequence import END as END
from ._sequence import After as After
from ._sequence import Aim as Aim
from ._sequence import Arrived as Arrived
from ._sequence import GripperMove as GripperMove
from ._sequence import Sequence as Sequence
from ._sequence import State as State
from ._states import perform as perform
from ._states import reach as reach
from ._toml import SequenceFile as SequenceFile
from ._toml import load_sequence as load_sequence
