"""Hook of mkdocs: makes the built guide self-contained, fails if it would fetch other sites.

The theme adds a script from elsewhere that lets search work in a page opened as a file. It is left
out: search works where the folder is served (`python -m http.server -d site`), all else everywhere.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

from mkdocs.exceptions import PluginError

_SHIM: Final = re.compile(r'<script src="https://unpkg\.com/iframe-worker/shim"></script>')
_FETCHED: Final = re.compile(
    r"<(?:script|img|iframe|source)\b[^>]*\bsrc=[\"']?(https?:)?//[^\s\"'>]+"
    r"|<link\b[^>]*\brel=[\"']?(?:stylesheet|preconnect|preload)\b[^>]*//[^\s\"'>]+"
    r"|@import\s+[\"'](https?:)?//[^\"']+|url\([\"']?(https?:)?//[^)]+\)"
)


def on_post_page(output: str, **_: Any) -> str:
    """Leave the theme's script out."""
    return _SHIM.sub("", output)


def on_post_template(output_content: str, **_: Any) -> str:
    """The same of pages that no text of ours stands behind."""
    return _SHIM.sub("", output_content)


def on_post_build(config: Any, **_: Any) -> None:
    """Refuse a guide that would fetch something.

    Raises
    ------
    PluginError
        Naming the file and what it would fetch.
    """
    for path in sorted(Path(config.site_dir).rglob("*")):
        if path.suffix in (".html", ".css") and (found := fetched(path.read_text("utf-8"))):
            raise PluginError(f"{path} would fetch {found} from elsewhere; the guide works offline")


def fetched(text: str) -> str | None:
    """What a page or a style would fetch from another host; None for nothing."""
    found = _FETCHED.search(text)
    return None if found is None else found[0]
