"""Limit the size of request bodies and uploads, whatever they say of themselves."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import IO, Final

from starlette.exceptions import HTTPException
from starlette.types import Message, Receive, Scope

from printctl.web.errors import BadRequestError

PLAIN_BYTES: Final = 2_000_000
"""Of a request that is no upload."""
UPLOADS: Final = re.compile(
    r"/api/v1/(jobs|scans|history/verify|prints/[^/]+/photos|recipes/(import|files))"
)
"""Paths that take files."""
_PIECE: Final = 1 << 20


class TooLargeUploadError(BadRequestError):
    """More than may be sent."""

    status = 413


def limit_body(scope: Scope, receive: Receive, upload_bytes: int) -> Receive:
    """Return a ``receive`` that ends a request which is larger than its path takes.

    Raises
    ------
    HTTPException
        413, at once when the request says so itself, else from ``receive``.
    """
    limit = upload_bytes if UPLOADS.fullmatch(scope["path"]) else PLAIN_BYTES
    got = 0

    def check(size: int) -> None:
        if size > limit:
            text = f"the request is larger than {limit / 1e6:g} MB, the most that is taken here"
            raise HTTPException(413, text)

    for name, value in scope["headers"]:
        if name == b"content-length":
            check(int(value))  # h11 takes digits only

    async def counted() -> Message:
        nonlocal got
        message = await receive()
        got += len(message.get("body", b""))
        check(got)
        return message

    return counted


def save_upload(stream: IO[bytes], path: Path, limit_bytes: int) -> None:
    """Write an upload to the new file ``path``, in a folder that goes when this fails.

    Raises
    ------
    TooLargeUploadError
    BadRequestError
        When nothing came.
    """
    got = 0
    with path.open("xb") as file:
        while piece := stream.read(_PIECE):
            got += len(piece)
            if got > limit_bytes:
                raise TooLargeUploadError(
                    f"{path.name} is larger than {limit_bytes / 1e6:g} MB, the most that is taken "
                    "here; `printctl serve --upload-mb` sets it"
                )
            file.write(piece)
        file.flush()
        os.fsync(file.fileno())
    if not got:
        raise BadRequestError(f"{path.name} is empty")
