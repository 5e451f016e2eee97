"""Whether a person who waits sees how far learning is."""

import io
import sys

from jaxrmp.learning._progress import shown


class Terminal(io.StringIO):
    def isatty(self):
        return True


def drawn(monkeypatch, progress, file):
    monkeypatch.setattr(sys, "stderr", file)
    with shown(progress) as tell:
        tell("flow", 0.25)
        tell("gate", 1.0)
    return file.getvalue()


def test_a_terminal_sees_a_bar_by_default_and_none_if_asked(monkeypatch):
    text = drawn(monkeypatch, "shown", Terminal())
    assert "flow" in text and " 25 %" in text and "gate" in text
    assert drawn(monkeypatch, None, Terminal()) == ""
    assert drawn(monkeypatch, "shown", io.StringIO()) == "" or "ipykernel" in sys.modules


def test_a_function_is_called_as_it_is(monkeypatch):
    calls = []
    assert drawn(monkeypatch, lambda *said: calls.append(said), Terminal()) == ""
    assert calls == [("flow", 0.25), ("gate", 1.0)]


def test_without_tqdm_nothing_is_drawn(monkeypatch):
    monkeypatch.setitem(sys.modules, "tqdm", None)
    assert drawn(monkeypatch, "shown", Terminal()) == ""
