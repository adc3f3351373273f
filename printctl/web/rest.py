"""Root of the REST API, its refusals, who asks, strict bodies: shared by all routes."""

from __future__ import annotations

from typing import Annotated, Any, Final

from fastapi import Depends
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict
from starlette.requests import HTTPConnection

from printctl.web.controls import Principal

API: Final = "/api/v1"


class Body(BaseModel):
    """What is sent; unknown keys, NaN and infinity are refused."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


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
    404: _problem("there is no such thing"),
    409: _problem("not as things stand"),
    413: _problem("larger than may be sent"),
    421: _problem("asked for by a name that isn't this server's"),
    422: _problem("the request can't be taken; the message says what is wrong"),
    423: _problem("another browser holds the controls"),
}
GUARD_REFUSALS: Final[Refusals] = {status: REFUSALS[status] for status in (400, 401, 403, 413, 421)}
"""What every route may answer."""


def error_response(status: int, message: str, error: str) -> JSONResponse:
    """Return the answer that refuses a request, or reports a fault."""
    return JSONResponse({"error": error, "message": message}, status)


def requesting_user(asking: HTTPConnection) -> Principal:
    """Return who asks, as the guard found out."""
    principal: Principal | None = getattr(asking.state, "principal", None)
    return principal or Principal("local", "this machine")


Asking = Annotated[Principal, Depends(requesting_user)]
