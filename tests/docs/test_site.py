"""The documentation builds as a site without a warning, holds every public name, and fetches nothing."""

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ["jaxrmp", *(f"jaxrmp.{p.stem}" for p in sorted((ROOT / "docs" / "reference").glob("*.md")))]
NOT_ONE = {"jaxrmp.core": "jaxrmp", "jaxrmp.lula": "jaxrmp.leaves.lula"}


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    pytest.importorskip("material", reason="needs mkdocs-material: pip install 'jaxrmp[docs]'")
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(out)]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    )
    assert done.returncode == 0, done.stderr
    return out


def test_every_page_of_docs_is_there(site):
    for page in (ROOT / "docs").rglob("*.md"):
        assert (site / page.relative_to(ROOT / "docs").with_suffix(".html")).is_file()
    assert "Install" in (site / "index.html").read_text(encoding="utf-8")


def test_every_public_name_is_in_the_reference(site):
    text = "".join(p.read_text(encoding="utf-8") for p in (site / "reference").glob("*.html"))
    anchors = set(re.findall(r'id="(jaxrmp[\w.]*)"', text))
    for package in {NOT_ONE.get(name, name) for name in PACKAGES}:
        init = ast.parse((ROOT / package.replace(".", "/") / "__init__.py").read_text(encoding="utf-8"))
        imports = [node for node in init.body if isinstance(node, ast.ImportFrom) and node.module]
        names = {a.asname for node in imports for a in node.names if a.asname} - {"__version__"}
        assert names and {f"{package}.{name}" for name in names} <= anchors


def test_classes_show_their_fields_and_examples_are_code(site):
    text = (site / "reference" / "leaves.html").read_text(encoding="utf-8")
    attractor = re.sub(r"<[^>]+>", "", text.split('<h2 id="jaxrmp.leaves.Attractor"')[1].split("<h2 id=")[0])
    assert re.search(
        r"Attractor\(\s*goal: Finite\[Array\],\s*weight_near: NonNegative\[Array \| float\] = 10.0,", attractor
    )
    assert "<blockquote" not in text


def test_formulas_are_drawn(site):
    pages = {p.stem: p.read_text(encoding="utf-8") for p in site.glob("*.html")}
    assert pages["concepts"].count("<math") > 40 and pages["leaves"].count("<math") > 30
    for name, text in pages.items():
        assert "arithmatex" not in text and "merror" not in text, name
        assert not re.search(
            r"\\(frac|tfrac|nabla|dot|top|mathbb)\b", re.sub(r"<pre.*?</pre>", "", text, flags=re.S)
        ), name


def test_rows_of_leaves_lead_to_entries_of_the_reference(site):
    cells = re.findall(r'<td><a [^>]*href="([^"#]+)#([^"]+)"', (site / "leaves.html").read_text(encoding="utf-8"))
    assert len(cells) > 20
    for page, anchor in cells:
        assert f'id="{anchor}"' in (site / page).read_text(encoding="utf-8"), anchor


def test_nothing_is_fetched(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 25
    for page in pages:
        text = page.read_text(encoding="utf-8")
        fetched = re.findall(r'<(?:script|img|iframe)[^>]*\ssrc="(https?://[^"]+)', text)
        fetched += re.findall(r'<link[^>]*rel="(?:stylesheet|preconnect)"[^>]*href="(https?://[^"]+)', text)
        assert [url for url in fetched if "colab-badge" not in url] == [], page.name


def test_the_search_field_is_not_offered_where_a_browser_lets_it_find_nothing(site):
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("needs chromium")
    page = (site / "index.html").resolve().as_uri()
    command = [chromium, "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom", page]
    shown = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout
    assert re.search(r"<html[^>]*from-folder", shown) and ".from-folder .md-search" in shown
