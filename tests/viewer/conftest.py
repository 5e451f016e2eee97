"""Pages of ours in a real, headless Chromium, used as a person uses them."""

import shutil

import pytest

from benchmarks._page import Page, launch


@pytest.fixture(scope="module")
def chromium():
    """A browser for the tests of one file, or a skip that says what is missing."""
    pytest.importorskip("viser", reason="needs viser: pip install 'jaxrmp[viewer]'")
    pytest.importorskip("playwright", reason="needs playwright: pip install 'jaxrmp[dev]'")
    if shutil.which("chromium") is None:
        pytest.skip("needs Chromium (as root: apt-get install chromium), which make test installs where it may")
    with launch() as browser:
        yield browser


@pytest.fixture(scope="module")
def page_of(chromium):
    """The page of a session, `page_of(session)`: opened once for the tests of one file."""
    opened = {}

    def open_page(session) -> Page:
        if id(session) not in opened or opened[id(session)].page.is_closed():
            opened[id(session)] = Page(chromium, session.url)
        return opened[id(session)]

    yield open_page
    for page in opened.values():
        page.close()
