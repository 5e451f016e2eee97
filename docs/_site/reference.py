"""The reference: every public name of a package, and the examples in docstrings as code."""

import ast
import re
from pathlib import Path

from markdown import Extension
from markdown.preprocessors import Preprocessor
from mkdocs.config.defaults import MkDocsConfig

ROOT = Path(__file__).parents[2]
_PACKAGE = re.compile(r"^::: (jaxrmp(?:\.[a-z_]+)*)$", re.MULTILINE)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    config.markdown_extensions.append(_Doctests())  # pyright: ignore[reportArgumentType]
    return config


def on_page_markdown(markdown: str, **kwargs) -> str:
    """`::: jaxrmp.package` becomes what the package says of itself, and an entry for each of its public names."""

    def expand(match: re.Match) -> str:
        name = match[1]
        source = ast.parse((ROOT / name.replace(".", "/") / "__init__.py").read_text(encoding="utf-8"))
        entries = [f"::: {name}.{public}" for public in sorted(public_names(source), key=_classes_first)]
        return "\n\n".join([ast.get_docstring(source) or "", f"`import {name}`", *entries])

    return _PACKAGE.sub(expand, markdown)


def public_names(source: ast.Module) -> list[str]:
    """What a package re-exports as `from ._module import Name as Name`."""
    imports = [node for node in source.body if isinstance(node, ast.ImportFrom) and node.module]
    return [alias.name for node in imports for alias in node.names if alias.asname and alias.name[:2] != "__"]


def _classes_first(name: str) -> tuple[int, str]:
    return (0 if name[0].isupper() else 1, name.lower())


class _Doctests(Extension):
    def extendMarkdown(self, md):
        md.preprocessors.register(_FenceDoctests(md), "doctests", 29)  # before fenced code is looked for


class _FenceDoctests(Preprocessor):
    """A paragraph that begins with `>>>` is an example, not a quotation."""

    def run(self, lines: list[str]) -> list[str]:
        found: list[str] = []
        fenced = example = False
        for line in lines:
            if line.startswith("```"):
                fenced = not fenced
            if not fenced and not example and line.startswith(">>> "):
                example = True
                found.append("```pycon")
            elif example and not line.strip():
                example = False
                found.append("```")
            found.append(line)
        return found + ["```"] * example
