"""Pages from outside docs/.

README, CONTRIBUTING and CHANGELOG become pages, and so do the notebooks, from their paired scripts. Links between
files of the repository become links between pages, or to copies of the files.
"""

import posixpath
import re
from pathlib import Path

import jupytext
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
PAGES = {"README.md": "index.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
PAGES |= {f"notebooks/{p.name}": f"notebooks/{p.stem}.md" for p in sorted((ROOT / "notebooks").glob("*.py"))}
_LINK = re.compile(r"(\]\()([^)#\s:]+)((?:#[^)\s]*)?\))")
_FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Pages and files from outside docs/ join those inside."""
    for source, page in PAGES.items():
        files.append(File.generated(config, page, content=_text(ROOT / source)))
    for target in sorted(_linked(files) - PAGES.keys()):
        files.append(File.generated(config, f"files/{target}", abs_src_path=str(ROOT / target)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links between files of the repository lead to pages of the site, or to copies of the files."""
    origin, here = _origin(page.file.src_uri), posixpath.dirname(page.file.src_uri) or "."

    def lead(match: re.Match) -> str:
        target = _resolved(origin, match[2])
        return f"{match[1]}{posixpath.relpath(_place(target), here)}{match[3]}"

    return _outside_code(markdown, lambda text: _LINK.sub(lead, text))


def _text(path: Path) -> str:
    return jupytext.writes(jupytext.read(path), "md") if path.suffix == ".py" else path.read_text(encoding="utf-8")


def _origin(page: str) -> str:
    """The file of the repository that a page comes from."""
    return next((source for source, uri in PAGES.items() if uri == page), f"docs/{page}")


def _resolved(origin: str, target: str) -> str:
    return posixpath.normpath(posixpath.join(posixpath.dirname(origin), target))


def _place(target: str) -> str:
    """Where the site has a file of the repository."""
    if target.startswith("docs/"):
        return target.removeprefix("docs/")
    return PAGES.get(target, f"files/{target}")


def _linked(files: Files) -> set[str]:
    """All files outside docs/ that a page links to."""
    found = set()
    for file in files.documentation_pages():
        origin = _origin(file.src_uri)
        targets = {_resolved(origin, m[2]) for m in _LINK.finditer(_FENCE.sub("", file.content_string))}
        found |= {t for t in targets if not t.startswith("docs/") and (ROOT / t).is_file()}
    return found


def _outside_code(markdown: str, change) -> str:
    at, parts = 0, []
    for block in _FENCE.finditer(markdown):
        parts += [change(markdown[at : block.start()]), block[0]]
        at = block.end()
    return "".join([*parts, change(markdown[at:])])
