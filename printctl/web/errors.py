"""Errors of the web server, each with its HTTP status.

WebError
├── NotAllowedError         401 or 403: no session, wrong token, foreign origin
├── NotInControlError       423: another browser holds the controls
├── NotFoundError           404
├── BadRequestError         422: the request, an upload or a recipe can't be taken
└── ConflictError           409: not in this state
    └── ChangedError        409: changed elsewhere since it was read
"""

from __future__ import annotations

from typing import ClassVar

from printctl.errors import PrintctlError


class WebError(PrintctlError):
    """Base of what the server refuses."""

    status: ClassVar[int] = 400


class NotAllowedError(WebError):
    """Nobody who may."""

    status = 403


class NotInControlError(WebError):
    """Another browser holds the controls."""

    status = 423


class NotFoundError(WebError):
    """There is no such thing in the workspace."""

    status = 404


class BadRequestError(WebError):
    """What was sent can't be taken."""

    status = 422


class ConflictError(WebError):
    """Not while things stand as they do."""

    status = 409


class ChangedError(ConflictError):
    """Something was changed elsewhere since it was read; the message has both versions."""
