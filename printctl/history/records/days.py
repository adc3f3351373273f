"""Parse a calendar day's text into the start and end of that day, in s since 1970."""

from __future__ import annotations

from datetime import datetime, timedelta

from printctl.errors import UsageError


def day_begins(text: str, where: str) -> float:
    """When a day begins here, s since 1970; 0 for no text.

    Raises
    ------
    UsageError
    """
    return _day(text, where).timestamp() if text else 0.0


def day_ends(text: str, where: str) -> float:
    """When the next day begins here, s since 1970; 0 for no text.

    Raises
    ------
    UsageError
    """
    return (_day(text, where) + timedelta(days=1)).timestamp() if text else 0.0


def _day(text: str, where: str) -> datetime:
    try:
        day = datetime.strptime(text, "%Y-%m-%d")
        if 1971 <= day.year <= 9000:
            return day
    except ValueError:
        pass
    raise UsageError(f"{where} {text[:40]!r} is no day; write it like 2026-11-21")
