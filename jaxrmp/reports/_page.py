"""Reports as pages that need nothing else: pictures inside, readable without the library and without a network."""

import base64
import html
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from .._files import atomic_write

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1b1f23; max-width: 68rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; margin: 0.5rem 0 1.5rem; display: block; overflow-x: auto; }
th, td { text-align: right; padding: 0.2rem 0.8rem; border-bottom: 1px solid #ddd; }
th:first-child, td:first-child { text-align: left; }
img, video { max-width: 100%; height: auto; }
figure { margin: 1.5rem 0; }
figcaption { color: #55616b; }
"""

_UNITS = {"s": "s", "rad": "rad", "m": "m", "mm": "mm", "cm": "cm", "deg": "degrees", "hz": "Hz"}


def write_page(path: str | os.PathLike, title: str, parts: Iterable[str]) -> Path:
    """Write a page of `parts`, which the functions below make; it appears whole or not at all."""
    path = Path(path)
    name = html.escape(title)
    page = (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{name}</title>'
        f"<style>{_STYLE}</style></head><body><h1>{name}</h1>{''.join(parts)}</body></html>\n"
    )
    with atomic_write(path) as file:
        file.write(page.encode())
    return path


def heading(text: str) -> str:
    """A heading between sections."""
    return f"<h2>{html.escape(text)}</h2>"


def paragraph(text: str) -> str:
    """A paragraph of plain text; what stands in `backticks` is set as code."""
    odd_is_code = enumerate(html.escape(text).split("`"))
    return f"<p>{''.join(f'<code>{part}</code>' if i % 2 else part for i, part in odd_is_code)}</p>"


def table(head: list, rows: list[list], empty: str = "") -> str:
    """A table, or the sentence `empty` if it has no rows."""
    if not rows:
        return paragraph(empty)
    cells = "".join(f"<th>{html.escape(str(c))}</th>" for c in head) if any(head) else ""
    body = "".join("<tr>" + "".join(f"<td>{html.escape(str(c))}</td>" for c in row) + "</tr>" for row in rows)
    return f"<table><tr>{cells}</tr>{body}</table>"


def records(entries: Iterable[Any], columns: Mapping[str, Callable[[Any], Any]]) -> str:
    """A table of a row for each of `entries`: by the heading of each column, what it says of one; without columns that
    are empty in every row."""
    entries = list(entries)
    cells = {name: [cell(entry) for entry in entries] for name, cell in columns.items()}
    said = {name: column for name, column in cells.items() if not entries or any(value != "" for value in column)}
    return table([*said], [list(row) for row in zip(*said.values(), strict=True)])


def pictures(figures: Mapping[str, tuple[bytes, str]]) -> str:
    """PNG pictures, each under its heading with a sentence on what it shows."""
    parts = []
    for name, (png, caption) in figures.items():
        data = base64.b64encode(png).decode()
        parts.append(
            f'{heading(name)}<figure><img alt="{html.escape(name)}" src="data:image/png;base64,{data}">'
            f"<figcaption>{html.escape(caption)}</figcaption></figure>"
        )
    return "".join(parts)


def video(path: str | os.PathLike, caption: str) -> str:
    """The video of a file, MP4 or GIF, in the page, with a sentence on what it shows."""
    data, kind = base64.b64encode(Path(path).read_bytes()).decode(), Path(path).suffix[1:]
    shown = (
        f'<video controls loop muted playsinline src="data:video/mp4;base64,{data}"></video>'
        if kind == "mp4"
        else f'<img alt="video" src="data:image/gif;base64,{data}">'
    )
    return f"{heading('Video')}<figure>{shown}<figcaption>{html.escape(caption)}</figcaption></figure>"


def settings(report: Mapping[str, Any], names: Iterable[str]) -> str:
    """The entries `names` of a report that it has, as a table each, in words; what is not set is left out."""
    return "".join(
        heading(name.replace("_", " ").capitalize()) + table(["", ""], [[*row] for row in _flat(report[name])])
        for name in names
        if name in report and _flat(report[name])
    )


def percent(share: float) -> str:
    return f"{100 * share:.2f} %"


def numbers(values: Iterable[float], digits: int = 3) -> str:
    return ", ".join(f"{v:.{digits}f}" for v in values)


def _flat(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    rows: list[tuple[str, Any]] = []
    for name, value in values.items():
        named = prefix + _with_unit(name)
        if isinstance(value, Mapping):
            rows += _flat(value, f"{named}: ")
        elif isinstance(value, list | tuple) and value and all(isinstance(entry, Mapping) for entry in value):
            for k, entry in enumerate(value):
                rows += _flat(entry, f"{named} {k + 1}: ")
        elif value is not None and value != "" and value != [] and value != ():
            rows.append((named, _in_words(value)))
    return rows


def _with_unit(name: str) -> str:
    """`start_margin_rad` as "start margin, rad"."""
    *words, last = name.split("_")
    return f"{' '.join(words)}, {_UNITS[last]}" if words and last in _UNITS else " ".join([*words, last])


def _in_words(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(map(_in_words, value))
    if isinstance(value, float):
        return "never" if value == float("inf") else f"{value:.6g}"
    return str(value)
