"""How large a request may be."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from fastapi.params import File
from fastapi.routing import APIRoute
from starlette.exceptions import HTTPException
from starlette.types import Message, Receive, Scope

PLAIN_BYTES: Final = 2_000_000
"""Of a request that is no upload."""

_UPLOAD_OF_NICEGUI: Final = re.compile(r"/_nicegui/client/.*/upload/.*")
_MARK: Final = "printctl_takes_upload"

Endpoint = TypeVar("Endpoint", bound=Callable[..., Any])


def takes_upload(endpoint: Endpoint) -> Endpoint:
    """Mark an endpoint that reads a large body as a stream; one with an `UploadFile` needn't."""
    setattr(endpoint, _MARK, True)
    return endpoint


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
    def of(cls, routes: Iterable[Any], upload_mb: float) -> BodyLimits:
        """Limits of an app's routes."""
        paths = [r.path_regex for r in routes if isinstance(r, APIRoute) and _uploads(r)]
        return cls(int(upload_mb * 1e6), (_UPLOAD_OF_NICEGUI, *paths))

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
        said = dict(scope["headers"]).get(b"content-length", b"0")
        if not said.isdigit() or int(said[:20]) > limit:
            raise TooLargeError(limit)

        async def counted() -> Message:
            nonlocal got
            message = await receive()
            got += len(message.get("body", b""))
            if got > limit:
                raise TooLargeError(limit)
            return message

        return counted


def _uploads(route: APIRoute) -> bool:
    fields = route.dependant.body_params
    return hasattr(route.endpoint, _MARK) or any(isinstance(f.field_info, File) for f in fields)
