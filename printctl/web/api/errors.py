"""Turn exceptions into REST error responses: ``{"error": class, "message": text}`` and status."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any, Final

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.requests import Request

from design.errors import DesignError
from firmware_profiles import ProfileError
from firmware_profiles.errors import wording
from printctl.errors import PrintctlError
from printctl.machine.link.errors import LinkError
from printctl.system_errors import explain
from registration.errors import RegistrationError

log = logging.getLogger("printctl.web")
_CONFLICT = 409
_SHOWN: Final = 60
"""Longest value shown, characters."""


def answer_errors(app: FastAPI) -> None:
    """Have the app answer a refusal by its message."""
    for kind in (PrintctlError, LinkError, ProfileError, DesignError, RegistrationError):
        app.add_exception_handler(kind, _refused)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(HTTPException, _http)
    for trouble in (OSError, MemoryError):
        app.add_exception_handler(trouble, _system)
    app.add_exception_handler(Exception, _own)


def answer_unknown(app: FastAPI, root: str) -> None:
    """Have the app refuse whatever else is asked below ``root``, before its pages answer it.

    Parameters
    ----------
    app : FastAPI
        With all its routes but the pages'.
    root : str
        Where the API begins.
    """

    @app.api_route(
        f"{root}/{{rest:path}}",
        methods=["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE"],
        include_in_schema=False,
    )
    def unknown(request: Request) -> JSONResponse:
        what = f"{request.method} {request.url.path}"
        return error_response(
            404, "NotFoundError", f"the API has no {what}; /api/docs lists what it has"
        )


async def _refused(request: Request, exc: Exception) -> JSONResponse:
    return error_response(getattr(exc, "status", _CONFLICT), type(exc).__name__, str(exc))


async def _invalid(request: Request, exc: Exception) -> JSONResponse:
    problems = exc.errors() if isinstance(exc, RequestValidationError) else []
    return error_response(
        422, "BadRequestError", "; ".join(map(_sentence, problems)) or "the request can't be read"
    )


def _sentence(problem: Mapping[str, Any]) -> str:
    """One wrong value of a request: its place, what it must be, and what it is."""
    place, value = ".".join(map(str, problem["loc"])), repr(problem.get("input"))
    if problem["type"] == "missing":
        return f"{place} is missing; add it"
    shown = value if len(value) <= _SHOWN else f"{value[:_SHOWN]}..."
    return f"{place} {wording(problem)} (is {shown})"


async def _system(request: Request, exc: Exception) -> JSONResponse:
    """Answer what the system refused: a full disk, rights, too many files, memory."""
    log.error("%s %s: %r", request.method, request.url.path, exc)
    assert isinstance(exc, OSError | MemoryError)
    explained = explain(exc)
    return error_response(explained.status, explained.kind, explained.message)


async def _own(request: Request, exc: Exception) -> JSONResponse:
    """Answer a fault of ours; the server writes its trace into the log."""
    name = type(exc).__name__
    return error_response(
        500, "ServerError", f"the server met an error of its own ({name}); its log has the details"
    )


async def _http(request: Request, exc: Exception) -> JSONResponse:
    if isinstance(exc.__cause__, OSError):  # an upload that couldn't be kept while it came
        return await _system(request, exc.__cause__)
    status = getattr(exc, "status_code", 500)
    names = {404: "NotFoundError", 405: "MethodNotAllowed"}
    answer = error_response(
        status, names.get(status, "HTTPException"), str(getattr(exc, "detail", exc))
    )
    answer.headers.update(getattr(exc, "headers", None) or {})
    return answer


def error_response(status: int, error: str, message: str) -> JSONResponse:
    """An error's answer."""
    return JSONResponse({"error": error, "message": message}, status)
