"""Notes made after a print's end: in the history, with their print."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

from printctl.machine.link.history import PrintHistory
from printctl.machine.link.print_notes import read_notes
from printctl.web.job.record import Records
from tests.printctl.machine.link.test_print_notes import begun


@pytest.fixture(autouse=True)
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))


def until_filed(operators: list[str]) -> None:
    """The history is told in a thread of its own."""
    limit = time.monotonic() + 20.0
    while [one.operator for one in PrintHistory().entries()] != operators:
        assert time.monotonic() < limit, PrintHistory().entries()
        time.sleep(0.05)


def test_a_name_given_after_the_end_is_found_and_stays_with_its_print(tmp_path: Path) -> None:
    records, folder = Records(tmp_path / "records"), tmp_path / "print"
    folder.mkdir()
    begun(folder, 1e9)
    PrintHistory().note(folder)
    record = records.current("file~a.gcode")
    records.mark(record, "Ada", started=1e9 + 1, folder=str(folder), ended=1e9 + 2)
    records.change(record, "Ada", {"operator": "Ada"})
    until_filed(["Ada"])
    journal = begun(folder, 2e9)  # the command line prints it once more
    PrintHistory().note(folder)
    records.change(record, "Ada", {"cells": "HUVEC"})
    until_filed(["", "Ada"])
    assert read_notes(journal) == {}
    beside = json.loads((folder / "record.1.json").read_text())
    assert beside["values"]["cells"] == "HUVEC"
