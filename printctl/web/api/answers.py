"""Documented REST error statuses with their JSON body, and the installed program version."""

from __future__ import annotations

from importlib import metadata
from typing import Any, Final

from pydantic import BaseModel

API: Final = "/api/v1"


class Problem(BaseModel):
    """Why something was refused."""

    error: str
    message: str


def _problem(text: str) -> dict[str, Any]:
    return {"model": Problem, "description": text}


Refusals = dict[int | str, dict[str, Any]]
REFUSALS: Final[Refusals] = {
    400: _problem("no HTTP/1.1 request, or a header that decides about access comes twice"),
    401: _problem("no session and no token, or a wrong one"),
    403: _problem("asked for by a page of another origin"),
    409: _problem("not as things stand"),
    413: _problem("larger than may be sent"),
    421: _problem("asked for by a name that isn't this server's"),
    422: _problem("the request can't be taken; the message says what is wrong"),
    423: _problem("another browser holds the controls"),
}
GUARD_REFUSALS: Final[Refusals] = {status: REFUSALS[status] for status in (400, 401, 403, 413, 421)}
"""What every route may answer."""


def our_version() -> str:
    """Version of the program, as installed."""
    try:
        return metadata.version("printctl")
    except metadata.PackageNotFoundError:  # run from its sources, not installed
        return "unknown"
