"""Looks held against the final scan: where lines should lie, what is missing, who disagrees."""

from __future__ import annotations

import numpy as np
import pytest

from printctl.machine.link.inserts import Insert
from printctl.observe.records import LookRecord
from printctl.pipeline.tracing import Job
from printctl.pipeline.written_in_scan import (
    looks_and_scan,
    save_written,
    written_places,
)
from sim.gcode.deposit.strands import Strands

LENGTH = 10.0


@pytest.fixture
def job() -> Job:
    """Two layers of two lines of 10 mm each, 0.1 mm high; the G-code's lines 11 to 14."""
    y, z = np.array([0.0, 1.0, 0.0, 1.0]), np.array([0.1, 0.1, 0.2, 0.2])
    start = np.stack([np.zeros(4), y, z], axis=1)
    end = start + [LENGTH, 0, 0]
    number = np.arange(4)
    moves = Strands.dosed(start, end, np.ones(4), number, number + 11)
    return Job(moves, number // 2, False, np.array([11, 13]), np.array([12, 14]))


def look(number: int, line: int, seen=1.0, ink=1.0, decision="go_on", gaps=()) -> LookRecord:
    found = {"seen_share": seen, "coverage": ink, "gaps": list(gaps)}
    mark = f"end of layer {number - 1}, reload point"
    return LookRecord(number, line, line, mark, 0.0, decision, "", found=found)


def compared(tmp_path, job, scan, looks, inserts=()):
    """Rows for a scan given by what it has at a place (x, y, z)."""
    places = written_places(job, layered=True)
    ink = np.array([scan(*at) for at in places.at_mm], dtype=float)
    path = tmp_path / "written.npz"
    save_written(path, places, ink)
    return looks_and_scan(path, looks, inserts, [one.job_line for one in looks], 0.2)


def whole(x, y, z):
    return 1.0


def hole(x, y, z):
    """3 mm of the first layer's second line."""
    return 0.0 if y == 1.0 and z < 0.1 and 4 < x < 7 else 1.0


TWO = [look(1, 12), look(2, 14)]


def test_a_whole_print_agrees(tmp_path, job):
    rows = compared(tmp_path, job, whole, TWO)
    assert [row["agree"] for row in rows] == [True, True]
    assert [row["way_mm"] for row in rows] == [20.0, 20.0]
    assert [row["scan_ink"] for row in rows] == [1.0, 1.0]
    assert rows[0]["mark"] == "end of layer 0"


def test_what_a_look_called_whole_and_the_scan_misses_is_a_disagreement(tmp_path, job):
    first, second = compared(tmp_path, job, hole, TWO)
    assert first["agree"] is False
    assert first["words"] == "look: whole; scan: missing"
    assert first["scan_ink"] == pytest.approx(0.85)
    assert second["agree"] is True


def test_so_is_a_mend_that_the_scan_does_not_find(tmp_path, job):
    mend = Insert(1, 12, (b"G1 X1",), "a gap", 1.0)
    gaps = [{"from_mm": 4.0, "to_mm": 7.0}]
    looks = [look(1, 12, ink=0.85, decision="mend", gaps=gaps), TWO[1]]
    first, _ = compared(tmp_path, job, hole, looks, [mend])
    assert (first["agree"], first["mended"]) == (False, True)
    assert first["words"] == "look: mended; scan: missing"


def test_what_lies_where_the_look_did_not_judge_is_told_as_that(tmp_path, job):
    first, _ = compared(tmp_path, job, hole, [look(1, 12, seen=0.8), TWO[1]])
    assert first["agree"] is None
    assert first["words"] == "look: whole; scan: missing, perhaps unjudged"
    thin, _ = compared(tmp_path, job, hole, [look(1, 12, seen=0.8, ink=0.85), TWO[1]])
    assert thin["words"] == "look: whole; its own ink 85%; scan: missing, perhaps unjudged"


def test_gaps_that_were_left_and_are_not_in_the_scan_are_a_disagreement(tmp_path, job):
    gaps = [{"from_mm": 4.0, "to_mm": 7.0}]
    looks = [look(1, 12, ink=0.85, decision="pause", gaps=gaps), TWO[1]]
    first, _ = compared(tmp_path, job, whole, looks)
    assert first["agree"] is False
    assert first["words"] == "look: 3.00 mm left; scan: whole"
    both, _ = compared(tmp_path, job, hole, looks)
    assert both["agree"] is True


def test_what_a_mend_left_is_no_disagreement_with_a_scan_that_misses_it(tmp_path, job):
    mended = look(1, 12, ink=0.7, decision="mend", gaps=[{"from_mm": 1.0, "to_mm": 7.0}])
    mended.found["left_mm"] = 3.0
    first, _ = compared(
        tmp_path, job, hole, [mended, TWO[1]], [Insert(1, 12, (b"G1 X1",), "gaps", 1.0)]
    )
    assert first["words"] == "look: mended, 3.00 mm left; scan: missing"
    assert first["agree"] is True
