"""Reduce a registration report's verdict to one word: pass, fail or undecided."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

Outcome = Literal["pass", "fail", "undecided", ""]


def outcome(verdict: Mapping[str, Any] | None) -> Outcome:
    """``pass``, ``fail``, ``undecided`` (neither is proven), or empty for none."""
    if verdict is None or not isinstance(verdict.get("passed"), bool):
        return ""
    if verdict["passed"]:
        return "pass"
    return "undecided" if verdict.get("undecided") is True else "fail"
