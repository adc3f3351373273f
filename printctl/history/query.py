"""Query of past prints (filter, sort, page) and its conversion to SQL; one page of results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final

from printctl.pipeline.past.past_print import PrintEntry

PAGE: Final = 50
MOST: Final = 1000
"""Prints on one page, at most."""

_FOUND_IN: Final = (
    "id", "who", "host", "file", "path", "sha256", "profile", "port", "state", "message",
)  # fmt: skip
_ALARMS: Final = "(SELECT group_concat(a.text) FROM alarms a WHERE a.id = p.id)"
OPERATOR: Final = "(SELECT o.name FROM operators o WHERE o.id = p.id)"
_BY: Final = f"coalesce({OPERATOR}, p.who)"
COLUMN_OF: Final = {"profile": "p.profile", "who": _BY, "state": "p.state"}
"""SQL of what can be asked for by name; who printed is the operator, else the computer's user."""


def below_any(folders: Sequence[Path]) -> tuple[str, list[str]]:
    """Return SQL that is true of prints whose journal lies below a folder, and its values."""
    begins = [f"{folder / 'x'}"[:-1] for folder in folders]  # with the separator at its end
    return f"({' OR '.join(['instr(p.journal, ?) = 1'] * len(begins))})", begins


class SortBy(StrEnum):
    """Columns by which the history can be put in order."""

    STARTED = "started"
    ENDED = "ended"
    FILE = "file"
    PROFILE = "profile"
    WHO = "who"
    STATE = "state"


@dataclass(frozen=True)
class HistoryQuery:
    """Which prints are wanted; what is left empty doesn't narrow.

    Attributes
    ----------
    words : str
        All must occur somewhere in a print's record, capitals or not.
    states : tuple of str
        Ends; any of them.
    profile, who : str
        Exactly so.
    since, until : float, s since 1970
        Begun in this time; ``until`` isn't in it. 0 for open.
    sort : SortBy
    descending : bool
    limit : int or None
        None for all.
    offset : int
    within : tuple of Path
        Folders, resolved; the print's journal lies below one of them. Empty for anywhere.
    """

    words: str = ""
    states: tuple[str, ...] = ()
    profile: str = ""
    who: str = ""
    since: float = 0.0
    until: float = 0.0
    sort: SortBy = SortBy.STARTED
    descending: bool = True
    limit: int | None = None
    offset: int = 0
    within: tuple[Path, ...] = ()

    def condition(self) -> tuple[str, list[object]]:
        """SQL on ``prints p``, and its values."""
        places = [*(f"p.{name}" for name in _FOUND_IN), OPERATOR, _ALARMS]
        text = " || ' ' || ".join(f"coalesce({place}, '')" for place in places)
        words = self.words.split()
        parts = [f"instr(lower({text}), lower(?)) > 0"] * len(words)
        values: list[object] = list(words)
        if self.states:
            parts.append(f"p.state IN ({', '.join('?' * len(self.states))})")
            values.extend(self.states)
        narrowing: Sequence[tuple[str, object]] = (
            ("p.profile = ?", self.profile),
            (f"{_BY} = ?", self.who),
            ("p.started >= ?", self.since),
            ("p.started < ?", self.until),
        )
        parts += [sql for sql, value in narrowing if value]
        values += [value for _, value in narrowing if value]
        if self.within:
            below, folders = below_any(self.within)
            parts.append(below)
            values.extend(folders)
        return " AND ".join(parts) or "1", values

    def order(self) -> str:
        """SQL of the order and the page; the same prints never change places."""
        way = "DESC" if self.descending else "ASC"
        limit = -1 if self.limit is None else max(0, self.limit)
        column = COLUMN_OF.get(self.sort.value, f"p.{self.sort.value}")
        return (
            f"ORDER BY {column} {way}, p.started {way}, p.id "
            f"LIMIT {limit} OFFSET {max(0, self.offset)}"
        )


@dataclass(frozen=True)
class HistoryPage:
    """One page of query results.

    Attributes
    ----------
    entries : tuple of PrintEntry
    total : int
        On all pages.
    """

    entries: tuple[PrintEntry, ...]
    total: int
