"""Command-line text about print time and ink."""

from __future__ import annotations

from printctl.cli.process_lines import process_lines

FOUND = {
    "print_time_s": 1470.0,
    "changes_of_syringe": 0,
    "time_the_cells_have": "60 min (our protocol)",
    "ink_pushed_ul": 353.2,
    "ink_left_per_filling_ul": 20.3,
    "ink_needed_ul": 373.5,
    "fillings_hold_ul": 1000.0,
    "fillings": 1,
}


def test_time_and_ink_are_said_in_a_line_each() -> None:
    time, ink = process_lines(FOUND)
    assert time == "print time 24.5 min; time that the cells have: 60 min (our protocol)"
    assert ink == (
        "ink 373.5 µL: 353.2 pushed, 20.3 left behind by a filling; full, it holds 1000 µL"
    )


def test_changes_of_syringe_are_named_whether_they_are_timed_or_not() -> None:
    two = {**FOUND, "changes_of_syringe": 2, "fillings": 3}
    assert "24.5 min with 2 changes of syringe;" in process_lines(two)[0]
    assert "each of 3 fillings" in process_lines(two)[1]
    untimed = {**two, "changes_timed": False}
    assert "24.5 min and 2 changes of syringe, whose time isn't known;" in process_lines(untimed)[0]
