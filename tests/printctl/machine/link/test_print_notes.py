"""Operator's notes stay with their print when its folder is reused."""

from __future__ import annotations

import json
from pathlib import Path

from printctl.machine.link.history import PrintHistory
from printctl.machine.link.journal import Journal
from printctl.machine.link.print_notes import (
    archive_journal,
    journal_of,
    notes_path,
    read_notes,
)


def begun(folder: Path, started: float) -> Path:
    """A print's journal in a folder, those before put aside."""
    path = archive_journal(folder)
    journal = Journal(path)
    journal.add("job", name=f"{started:g}.gcode", sha256="h", lines=1, started=started)
    journal.add("end", state="done", done=1)
    journal.close()
    return path


def note(journal: Path, operator: str) -> None:
    notes_path(journal).write_text(json.dumps({"values": {"operator": operator}}))


def test_a_record_is_put_aside_with_its_journal(tmp_path: Path) -> None:
    note(begun(tmp_path, 1e9), "Ada")
    note(begun(tmp_path, 2e9), "Grace")
    begun(tmp_path, 3e9)
    history = PrintHistory(tmp_path / "data")
    history.note(tmp_path)
    assert [(one.file, one.operator) for one in history.entries()] == [
        ("3e+09.gcode", ""),
        ("2e+09.gcode", "Grace"),
        ("1e+09.gcode", "Ada"),
    ]
    assert sorted(path.name for path in tmp_path.glob("record*")) == [
        "record.1.json",
        "record.2.json",
    ]


def test_a_journal_is_found_by_when_its_print_began(tmp_path: Path) -> None:
    for started in (1e9, 2e9, 3e9):
        begun(tmp_path, started)
    found = [journal_of(tmp_path, "", at).name for at in (0.5e9, 1e9, 2.5e9, 9e9)]
    assert found == ["journal.log", "journal.1.log", "journal.2.log", "journal.log"]


def test_what_cannot_be_read_counts_as_nothing(tmp_path: Path) -> None:
    journal = begun(tmp_path, 1e9)
    assert read_notes(journal) == {}
    for text in ("[1]", '{"values": ', "[" * 100_000):
        notes_path(journal).write_text(text)
        assert read_notes(journal) == {}
    (tmp_path / "journal.7.log").write_bytes(b"torn")
    assert journal_of(tmp_path, "", 2e9) == journal
