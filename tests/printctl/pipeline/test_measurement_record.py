"""Measurement record: stated facts kept, missing or wrong ones reported."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from printctl.cli.part_file import read_record
from printctl.errors import UsageError
from printctl.pipeline.measurement_record import Corrections, add_record
from printctl.recipe.record import RecordPart
from registration.report.measurement_tables import record_facts
from registration.report.page import report_html
from registration.scan import Scan
from registration.wall_reference import WallCalibration

NOW = datetime(2026, 4, 2, 12, 0, tzinfo=UTC)
RECORD = """
instrument: Acme OCT-1
serial: "0042"
certificate: {number: C-7, issued: 2025-03-01, valid_until: 2026-03-01, by: Lab X}
operator: A. Smith
part: P1
scanned: 2026-04-01T14:00+02:00
temperature_c: 31
temperature_range_c: [18, 24]
"""


def scan() -> Scan:
    volume = np.zeros((2, 2, 2), dtype=np.uint8)
    return Scan(volume, (0.01, 0.02, 0.02), 1.36, True, "db", "oct", True, Path("s.tif"))


def recorded(stated: RecordPart, part: Scan | None = None) -> dict[str, Any]:
    numbers: dict[str, Any] = {"notes": ["first"], "judging": {"rule": "JCGM 106: words"}}
    add_record(numbers, stated, part or scan(), Corrections(), NOW)
    return numbers


def test_a_record_is_kept_and_what_is_wrong_with_it_noted(tmp_path: Path) -> None:
    path = tmp_path / "record.yaml"
    path.write_text(RECORD + "material: GelMA 10 %\n")
    walls = WallCalibration(4.5, 0.6, 400.0, 1000.0, 3, None, "oct", "Acme OCT-1", "GelMA 5 %")
    found = recorded(read_record(path), replace(scan(), walls=walls))
    record, notes = found["record"], found["notes"]
    assert (record["operator"], record["part"], record["serial"]) == ("A. Smith", "P1", "0042")
    assert record["certificate"]["valid_until"] == "2026-03-01"
    assert record["age_at_registration_h"] == 24.0
    assert notes[0] == "first"
    assert "certificate ended on 2026-03-01, before the scan of 2026-04-01" in notes[1]
    assert "31 °C is outside the stated range of 18 to 24 °C" in notes[2]
    assert notes[3].startswith("The walls' offset was measured with material GelMA 5 %, and this")
    assert len(notes) == 4
    assert "place of the walls, by a reference of known diameters" in record["corrected"]
    assert "beam's fan and bow" in record["not_corrected"]


def test_what_is_missing_is_said_to_be_not_stated() -> None:
    found = recorded(RecordPart())
    assert found["notes"] == ["first"]
    said = {fact.label: fact.value for fact in record_facts(found)}
    assert said["Operator"] == said["Certificate"] == said["Time of the scan"] == "not stated"
    assert said["Decision rule"] == "JCGM 106: words"
    page = report_html({"registration": found, "scan": {"source": "s.tif"}}, [], None, {})
    assert "Measurement record" in page
    assert "not stated" in page
    assert record_facts({}) == []


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("scanned: 2026-04-01T14:00", "has no time zone"),
        ("certificate: {issued: soon}", "is no date"),
        ("temperature_range_c: [24, 18]", "let it rise"),
        ("colour: red", "colour"),
    ],
)
def test_a_wrong_record_is_refused(tmp_path: Path, line: str, why: str) -> None:
    path = tmp_path / "record.yaml"
    path.write_text(line + "\n")
    with pytest.raises(UsageError, match=why):
        read_record(path)
