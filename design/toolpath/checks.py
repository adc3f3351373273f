"""Refuse numeric toolpath options that aren't finite and above 0 (or at least 0)."""

from __future__ import annotations

import math

from design.errors import ToolpathError


def require_positive(where: str, **values: float) -> None:
    """Raise `ToolpathError` for the first value that isn't finite and above 0."""
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0):
            raise ToolpathError(f"{name} is {value:g} ({where}); it must be finite and above 0")


def require_not_negative(where: str, **values: float) -> None:
    """Raise `ToolpathError` for the first value that isn't finite and at least 0."""
    for name, value in values.items():
        if not (math.isfinite(value) and value >= 0):
            raise ToolpathError(f"{name} is {value:g} ({where}); it must be finite and at least 0")
