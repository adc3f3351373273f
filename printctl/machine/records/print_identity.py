"""Identify a print by its journal: id, start time, G-code hash; for a scan's report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from printctl.machine.records.history_entry import entry_of
from printctl.machine.records.record import JOURNAL


def print_identity(folder: Path) -> dict[str, Any] | None:
    """Unique identity of a print; None where it has no journal.

    Parameters
    ----------
    folder : Path
        That holds the journal.

    Returns
    -------
    dict or None
        ``id`` (as `printctl history` names it), ``started`` (s since 1970), ``gcode_sha256``.
    """
    journal = folder / JOURNAL
    if not journal.is_file():
        return None
    entry = entry_of(journal)
    if entry is None:
        return None
    return {"id": entry.id, "started": entry.started or None, "gcode_sha256": entry.sha256}
