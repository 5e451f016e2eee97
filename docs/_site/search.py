"""The search field is offered where it works: a browser lets no page from a folder read the index."""

from typing import Any

_HIDE = (
    "<style>.from-folder .md-search, .from-folder label[for=__search] { display: none }</style>"
    '<script>if (location.protocol === "file:") document.documentElement.classList.add("from-folder")</script>'
)


def on_post_page(output: str, **_: Any) -> str:
    """Every page hides its search field when it is opened without a server."""
    return output.replace("</head>", f"{_HIDE}</head>", 1)
