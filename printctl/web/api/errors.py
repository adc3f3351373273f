"""Errors as the API answers them: ``{"error": class, "message": text}`` and a status."""

from __future__ import annotations

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.requests import Request

from design.errors import DesignError
from firmware_profiles import ProfileError
from printctl.errors import PrintctlError
from printctl.link.errors import LinkError
from registration.errors import RegistrationError

_CONFLICT = 409


def answer_errors(app: FastAPI) -> None:
    """Have the app answer a refusal by its message."""
    for kind in (PrintctlError, LinkError, ProfileError, DesignError, RegistrationError):
        app.add_exception_handler(kind, _refused)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(HTTPException, _http)


async def _refused(request: Request, exc: Exception) -> JSONResponse:
    return told(getattr(exc, "status", _CONFLICT), type(exc).__name__, str(exc))


async def _invalid(request: Request, exc: Exception) -> JSONResponse:
    problems = exc.errors() if isinstance(exc, RequestValidationError) else []
    said = [f"{'.'.join(map(str, one['loc']))}: {one['msg']}" for one in problems]
    return told(422, "BadRequestError", "; ".join(said) or "the request can't be read")


async def _http(request: Request, exc: Exception) -> JSONResponse:
    status = getattr(exc, "status_code", 500)
    names = {404: "NotFoundError", 405: "MethodNotAllowed"}
    answer = told(status, names.get(status, "HTTPException"), str(getattr(exc, "detail", exc)))
    answer.headers.update(getattr(exc, "headers", None) or {})
    return answer


def told(status: int, error: str, message: str) -> JSONResponse:
    """An error's answer."""
    return JSONResponse({"error": error, "message": message}, status)
