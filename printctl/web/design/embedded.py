"""HTTP response with a generated HTML page (network, layers, report) for a sandboxed frame.

It runs its own scripts in a sandbox: without our origin it has neither cookies nor the API.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

from starlette.responses import HTMLResponse

Theme = Literal["system", "light", "dark"]

POLICY: Final = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline' data:; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'self'"
)
"""The page's own policy, which names its scripts by hash, holds as well."""


_BARE: Final = "body > header, body > footer { display: none } body { padding: 8px }"


def embedded(path: Path, theme: Theme = "system", bare: bool = False) -> HTMLResponse:
    """The page as an answer that may be framed by our pages alone.

    Parameters
    ----------
    path : Path
        An HTML file that the product wrote.
    theme : Theme
    bare : bool
        Without its own head and foot: what stands there stands around it.
    """
    text = path.read_text(encoding="utf-8")
    if bare:
        text = text.replace("</head>", f"<style>{_BARE}</style></head>", 1)
    if theme != "system":
        text = text.replace('<html lang="en">', f'<html lang="en" data-theme="{theme}">', 1)
    return HTMLResponse(
        text,
        headers={
            "Content-Security-Policy": POLICY,
            "X-Frame-Options": "SAMEORIGIN",
            "Cache-Control": "no-store",
        },
    )
