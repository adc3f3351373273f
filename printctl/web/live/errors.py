"""Exception class for a job that the live view can't show."""

from __future__ import annotations

from printctl.errors import UsageError


class SceneError(UsageError):
    """A job can't be shown; the message says why."""
