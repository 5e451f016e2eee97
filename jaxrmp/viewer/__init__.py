"""Pages in the browser: a policy running live, and teaching by hand. Nothing but the command line imports this."""

from ._content import reach_content as reach_content
from ._content import skill_content as skill_content
from ._recorder import Recorder as Recorder
from ._recorder import Recording as Recording
from ._server import Access as Access
from ._session import Content as Content
from ._session import Session as Session
from ._teacher import Teacher as Teacher
from ._viewer import Viewer as Viewer
