"""Refuse HTTP requests with a body above the limit of their path, plain or upload."""

from __future__ import annotations

import re
from dataclasses import dataclass
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
    """Limits by path.

    Attributes
    ----------
    upload_bytes : int
        Of a path that takes uploads.
    uploads : tuple of patterns
        Those paths.
    """

    upload_bytes: int
    uploads: tuple[re.Pattern[str], ...] = (_UPLOAD_OF_NICEGUI,)

    @classmethod
    def of(cls, openapi: dict[str, Any], upload_mb: float) -> BodyLimits:
        """Limits of an API, by its description: uploads are what takes a file."""
        paths = [path for path, item in openapi["paths"].items() if _takes_file(item)]
        patterns = [re.compile(re.sub(r"\\\{[^/]+\\\}", "[^/]+", re.escape(one))) for one in paths]
        return cls(int(upload_mb * 1e6), (_UPLOAD_OF_NICEGUI, *patterns))

    def limit(self, path: str) -> int:
        """Bytes of a request to ``path``."""
        return self.upload_bytes if any(p.fullmatch(path) for p in self.uploads) else PLAIN_BYTES

    def limited(self, scope: Scope, receive: Receive) -> Receive:
        """Give a ``receive`` that ends what is larger.

        Raises
        ------
        TooLargeError
            At once when the request says so itself, else from ``receive``.
        """
        limit, got = self.limit(scope["path"]), 0
        length = dict(scope["headers"]).get(b"content-length", b"0")
        if not length.isdigit() or int(length[:20]) > limit:
            raise TooLargeError(limit)

        async def counted() -> Message:
            nonlocal got
            message = await receive()
            got += len(message.get("body", b""))
            if got > limit:
                raise TooLargeError(limit)
            return message

        return counted


def _takes_file(item: dict[str, Any]) -> bool:
    bodies = [one.get("requestBody", {}).get("content", {}) for one in item.values()]
    return any(kind in body for body in bodies for kind in _FILES)
