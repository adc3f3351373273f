"""History as CSV, and a print's timeline."""

from __future__ import annotations

import csv
import io
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printctl.history.table import csv_lines, safe_cell
from printctl.history.timeline import time_line
from tests.printctl.history.records.prints import printed

CALCULATED = "=+-@"


@pytest.mark.parametrize(
    "text",
    [
        "=cmd|' /C calc'!A0",
        "+1",
        "-1",
        "@SUM(A1)",
        "\t=1",
        "\r=1",
        "\n=1",
        "  =1",
        "\ufeff=1",
        "＝1",
    ],
)
def test_cell_that_a_spreadsheet_would_calculate_begins_with_an_apostrophe(text):
    assert safe_cell(text) == f"'{text}"


@given(st.text())
def test_no_text_begins_as_a_formula_and_none_is_lost(text):
    cell = safe_cell(text)
    assert not cell.lstrip(" \ufeff\u00a0").startswith(tuple(CALCULATED))
    assert cell.removeprefix("'") == text.replace("\0", "").removeprefix("'")


def test_every_text_of_a_print_is_made_safe(tmp_path):
    entry = replace(printed(tmp_path / "run"), who="=1+1", file='a,"b"\n=2', message="-3")
    (row,) = csv.DictReader(io.StringIO("".join(csv_lines([entry]))))
    assert (row["who"], row["file"], row["message"]) == ("'=1+1", 'a,"b"\n=2', "'-3")
    assert (row["state"], row["done"]) == ("done", "3")


def test_time_line_tells_states_alarms_and_how_long_it_was_held(tmp_path):
    entry = printed(tmp_path / "run")
    line = time_line(entry.journal)
    assert [event.kind for event in line.events] == ["begun", "state", "state", "alarm", "end"]
    assert [stretch.state for stretch in line.stretches] == ["printing", "paused"]
    assert line.held_s == line.stretches[1].end_s - line.stretches[1].start_s
    assert line.more == 0
