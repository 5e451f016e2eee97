"""A page behind a password: nothing of it, nor its websocket, without one."""

import base64
import http.client
import time

import pytest

WORD = "correct horse"


@pytest.fixture(scope="module")
def opened():
    pytest.importorskip("viser", reason="needs viser: pip install 'jaxrmp[viewer]'")
    from jaxrmp.viewer._server import Access, open_server

    opened = open_server(0, "test", Access("127.0.0.1", WORD))
    opened.server.gui.add_markdown("60 updates/s")
    yield opened
    opened.stop()


def ask(opened, path="/", method="GET", **headers):
    """The status of an answer, and its headers."""
    connection = http.client.HTTPConnection("127.0.0.1", opened.port, timeout=30)
    connection.request(method, path, headers=headers)
    answer = connection.getresponse()
    answer.read() if answer.status != 101 else None
    connection.close()
    return answer.status, dict(answer.getheaders())


def basic(word: str) -> str:
    return "Basic " + base64.b64encode(f"anybody:{word}".encode()).decode()


def test_only_who_gives_the_password_gets_the_page_and_its_websocket(opened):
    socket = {"Upgrade": "websocket", "Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ=="}
    for headers in ({}, socket, {"Cookie": f"jaxrmp_{opened.port}=guessed"}, {"Authorization": "Basic ?"}):
        status, found = ask(opened, **headers)
        assert status == 401 and found["WWW-Authenticate"].startswith("Basic ")
    begun = time.monotonic()
    assert ask(opened, Authorization=basic("wrong"))[0] == 401
    assert time.monotonic() - begun > 0.9  # a guess costs a second, so that nobody makes many
    status, found = ask(opened, "/index.html", Authorization=basic(WORD))
    assert (status, found["Location"]) == (
        303,
        f"http://127.0.0.1:{opened.port}/index.html",
    ) and "HttpOnly; SameSite=Strict" in found["Set-Cookie"]
    cookie = {"Cookie": found["Set-Cookie"].partition(";")[0]}
    assert ask(opened, **cookie)[0] == 200
    assert ask(opened, method="POST", **cookie)[0] == 405
    ours = {"Origin": f"http://127.0.0.1:{opened.port}"}
    assert ask(opened, **socket, **cookie, **ours)[0] == 101
    assert ask(opened, **socket, **cookie, Origin="http://elsewhere.test")[0] == 403


def test_a_browser_shows_the_page_once_it_has_the_password(opened, chromium):
    from benchmarks._page import Page

    page = Page(chromium, f"http://anybody:{WORD.replace(' ', '%20')}@127.0.0.1:{opened.port}")
    try:
        assert page.received  # what the websocket brought
    finally:
        page.close()
