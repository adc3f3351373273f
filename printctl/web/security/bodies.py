"""Refuse HTTP requests with a body above the limit of their path, plain or upload."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

from starlette.exceptions import HTTPException
from starlette.types import Message, Receive, Scope

PLAIN_BYTES: Final = 2_000_000
"""Of a request that is no upload."""

_FILES: Final = ("multipart/form-data", "application/octet-stream")
_UPLOAD_OF_NICEGUI: Final = re.compile(r"/_nicegui/client/.*/upload/.*")


class TooLargeError(HTTPException):
    """More came than may."""

    def __init__(self, limit: int) -> None:
        text = f"the request is larger than {limit / 1e6:g} MB, the most that is taken here"
        super().__init__(413, text)


@dataclass(frozen=True)
class BodyLimits:
    """Limits by path: an upload's for what takes a file by the API's description.

    Attributes
    ----------
    openapi : callable
        Gives the description. It takes half a second to make, so it is asked for at the first
        request that is large.
    upload_bytes : int
        Of a path that takes uploads.
    """

    openapi: Callable[[], dict[str, Any]]
    upload_bytes: int

    @cached_property
    def uploads(self) -> tuple[re.Pattern[str], ...]:
        """Paths that take uploads."""
        paths = [path for path, item in self.openapi()["paths"].items() if _takes_file(item)]
        patterns = [re.compile(re.sub(r"\\\{[^/]+\\\}", "[^/]+", re.escape(one))) for one in paths]
        return _UPLOAD_OF_NICEGUI, *patterns

    def limit(self, path: str) -> int:
        """Bytes of a request to ``path``."""
        return self.upload_bytes if any(p.fullmatch(path) for p in self.uploads) else PLAIN_BYTES

    def exceeded(self, path: str, size: int) -> bool:
        """Whether a request of ``size`` bytes to ``path`` is too large."""
        return size > min(PLAIN_BYTES, self.upload_bytes) and size > self.limit(path)

    def limited(self, scope: Scope, receive: Receive) -> Receive:
        """Give a ``receive`` that ends what is larger.

        Raises
        ------
        TooLargeError
            At once when the request says so itself, else from ``receive``.
        """
        path, got = scope["path"], 0
        length = dict(scope["headers"]).get(b"content-length", b"0")
        if not length.isdigit() or self.exceeded(path, int(length[:20])):
            raise TooLargeError(self.limit(path))

        async def counted() -> Message:
            nonlocal got
            message = await receive()
            got += len(message.get("body", b""))
            if self.exceeded(path, got):
                raise TooLargeError(self.limit(path))
            return message

        return counted


def _takes_file(item: dict[str, Any]) -> bool:
    bodies = [one.get("requestBody", {}).get("content", {}) for one in item.values()]
    return any(kind in body for body in bodies for kind in _FILES)
