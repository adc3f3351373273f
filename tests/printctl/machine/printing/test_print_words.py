"""Progress of a print, in words."""

from __future__ import annotations

from pathlib import Path

from printctl.cli.status import status_lines
from printctl.machine.link.states import LinkState, Status
from printctl.machine.print_state.state import PrintTruth
from printctl.machine.printing.journal_facts import JournalledFacts
from printctl.machine.printing.print_words import progress_words


def truth() -> PrintTruth:
    status = Status(
        state=LinkState.FAILED, lines_done=9, lines_total=47, lines_executed=7, file_line=9
    )
    return PrintTruth(Path(), status)


def test_lines_are_told_as_lines_where_the_time_is_not_known():
    """Seven lines of 47, six of them a header, were told as 14.9 % made."""
    lines = status_lines(truth(), "run")
    assert lines[1].startswith("at least 7 of 47 lines made; 9 of 47 lines taken")
    assert truth().words["state"] == "Failed · at least 7 of 47 lines"


def test_status_tells_the_last_alarm_and_how_many_there_are():
    status = Status(LinkState.PRINTING, alarms=3, line_errors=2)
    lines = status_lines(
        PrintTruth(Path(), status, JournalledFacts(last_alarm="M204 R is 500")), "run"
    )
    assert "2 lines sent again" in lines
    assert "3 alarms, the last: M204 R is 500" in lines


def test_lines_that_were_acknowledged_are_told_where_none_was_surely_made():
    status = Status(state=LinkState.POSITION_UNKNOWN, lines_done=34, lines_total=74)
    assert "34 of 74" in progress_words(status, None)
