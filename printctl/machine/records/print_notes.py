"""Read the operator's notes beside a print's journal; archive an earlier journal with its notes.

A folder's last print has ``journal.log`` and ``record.json``; of those before, both were put aside
by one number: ``journal.2.log`` and ``record.2.json``.
"""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any, Final

from printctl.machine.records.journal import Record, print_id, read_records
from printctl.machine.records.record import JOURNAL

NOTED: Final = "record.json"
_LARGEST: Final = 16 * 2**20


def notes_path(journal: Path) -> Path:
    """Path of the record of a journal's print, whether it exists or not."""
    number = journal.name.removeprefix(Path(JOURNAL).stem).removesuffix(".log")
    return journal.with_name(f"record{number}.json")


def read_notes(journal: Path) -> dict[str, Any]:
    """What was noted of a journal's print; empty where nothing was, or it can't be read."""
    path = notes_path(journal)
    try:
        if path.stat().st_size > _LARGEST:
            return {}
        notes = json.loads(path.read_text(encoding="utf-8"), parse_constant=lambda _: None)
    except (OSError, ValueError, RecursionError):
        return {}
    return notes if isinstance(notes, dict) else {}


def archive_journal(folder: Path) -> Path:
    """Give an earlier print's journal and record a number, and the path of the new journal."""
    path = folder / JOURNAL
    if path.exists():
        count = len(list(folder.glob(f"{path.stem}.*{path.suffix}")))
        aside = folder / f"{path.stem}.{count + 1}{path.suffix}"
        if notes_path(path).exists():
            notes_path(path).replace(notes_path(aside))
        path.rename(aside)
    return path


def journal_of(folder: Path, identity: str, at: float) -> Path:
    """Return the journal of the print with an identity; the present journal where there is none.

    Without an identity that of the last print begun by ``at``, s since 1970.
    """
    begun = {}
    for path in folder.glob(f"{Path(JOURNAL).stem}*.log"):
        first = _job_record(path)
        if identity and first and print_id(first) == identity:
            return path
        with contextlib.suppress(TypeError, ValueError):
            begun[float(first.get("started", 0.0))] = path
    earlier = [started for started in begun if 0.0 < started <= at and not identity]
    return begun[max(earlier)] if earlier else folder / JOURNAL


def _job_record(journal: Path) -> Record:
    try:
        records = read_records(journal)
        return next((one for one in records if one and one.get("t") == "job"), {})
    except OSError:
        return {}
