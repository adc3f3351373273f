"""Test journals, closed at each test's end (`tests/printctl/machine/link/conftest.py`)."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from printctl.machine.link.journal import Journal

_OPEN: Final[list[Journal]] = []


def journal_in(folder: Path) -> Journal:
    """Open a print's journal."""
    journal = Journal(folder / "journal.log")
    _OPEN.append(journal)
    return journal


def close_all() -> None:
    """Close those that were opened."""
    while _OPEN:
        _OPEN.pop().close()
