"""Compress HTTP responses with gzip, except the live view's large scenes."""

from __future__ import annotations

import re
from typing import Final

from starlette.middleware.gzip import GZipMiddleware
from starlette.types import ASGIApp, Receive, Scope, Send

_FROM_BYTES: Final = 1000
_LEVEL: Final = 5
_SCENE: Final = re.compile(r"/live/[^/]+/scene")
"""Packed numbers: a million moves are 24 MB, which gzip holds up for seconds."""


class Compressed:
    """Middleware: gzip, but for the live view's scenes."""

    def __init__(self, app: ASGIApp) -> None:
        self._plain = app
        self._smaller = GZipMiddleware(app, minimum_size=_FROM_BYTES, compresslevel=_LEVEL)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request, as ASGI has it."""
        plain = scope["type"] == "http" and _SCENE.fullmatch(scope["path"]) is not None
        await (self._plain if plain else self._smaller)(scope, receive, send)
