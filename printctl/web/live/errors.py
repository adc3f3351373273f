"""Errors of a live view."""

from __future__ import annotations

from printctl.errors import UsageError


class SceneError(UsageError):
    """A job can't be shown; the message says why."""
