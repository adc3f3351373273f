"""Alarms and ends of a print in plain words, and where its tip is."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from printctl.machine.prints.alerts import alert_of
from printctl.machine.prints.progress import Progress
from printctl.machine.prints.state import assemble_state
from printctl.machine.prints.words import tip_words
from printctl.machine.records.journal import Journal
from printctl.machine.records.replay import JournalledPrint, read_journal_if_any
from printctl.machine.records.states import LinkState, Status

CODES = re.compile(r"\b[MG]\d{2,3}\b|`|X\d")
PROGRESS = Progress(
    commands=5, commands_total=10, file_line=5, share=0.5, predicted_s=1.0, predicted_total_s=2.0,
    active_s=1.0, remaining_s=1.0, remaining_error_s=None, ratio=1.0, ends_at=0.0, layer=1,
    layers=2, layers_done=0, passes=False, vessel=0, vessels=0, vessels_done=0, ink_ul=1.0,
    ink_total_ul=2.0, ink_left_ul=None, tip_mm=(53.5, 55.0, 10.0),
)  # fmt: skip


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("nobody confirmed for 5 min (dead-man)", "No operator has confirmed"),
        ("another program (cura 12) has this port open (/dev/ttyACM0): close it", "Another"),
        (
            "the bed is set to 20 °C, and this print had set 37 °C: another program did it; taken "
            "back (M140 S37)",
            "A heater",
        ),
        (
            "the ink stood still for 2.4 s between the end of line 1489 (X53.50)",
            "The needle stopped",
        ),
        ("7 line errors in 20 lines; pausing: check cable and grounding", "The connection"),
        ("pressure 120 kPa above 100 kPa (printer: watch)", "A watched reading"),
        ("X is 3.00 mm where the job says 3.50 mm", "The needle wasn't"),
        ("something new", "The printer reports something unusual"),
    ],
)
def test_an_alarm_says_what_it_means_and_what_to_do_without_codes(text: str, what: str) -> None:
    alert = alert_of(Status(LinkState.PRINTING, alarms=1), text, False)
    assert alert is not None
    assert alert.what.startswith(what)
    assert alert.detail == text
    assert all((alert.what, alert.means, alert.remedy))
    assert not CODES.search(" ".join((alert.what, alert.means, alert.remedy)))


@pytest.mark.parametrize("text", ["the ink stood still for 2 s", "something new"])
def test_after_done_no_alarm_says_that_the_print_goes_on(text: str) -> None:
    going_on = alert_of(Status(LinkState.PRINTING, alarms=1), text, False)
    done = alert_of(Status(LinkState.DONE, alarms=1), text, False)
    assert going_on is not None
    assert done is not None
    assert "print continues" in going_on.means
    assert "continues" not in done.means
    assert (done.what, done.remedy) == (going_on.what, going_on.remedy)


@pytest.mark.parametrize("state", [one for one in LinkState if Status(one).ended])
@pytest.mark.parametrize("known", [True, False])
def test_every_end_but_done_is_explained(state: LinkState, known: bool) -> None:
    message = "emergency stop by the user; M410 left the host after 0.1 ms; motors at X107.46"
    alert = alert_of(Status(state, message=message, position_known=known), "", False)
    assert (alert is None) == (state is LinkState.DONE and known)
    if alert is not None:
        assert not CODES.search(" ".join((alert.what, alert.means, alert.remedy)))


@pytest.mark.parametrize("state", [LinkState.STOPPED, LinkState.FAILED])
def test_a_needle_is_said_to_be_up_only_where_a_print_had_begun_and_its_place_is_known(
    state: LinkState,
) -> None:
    def means(lines_done: int, known: bool) -> str:
        alert = alert_of(Status(state, lines_done, 10, position_known=known), "", False)
        assert alert is not None
        return alert.means

    assert "lifted" in means(1, True)
    assert "lifted" not in means(0, True) + means(1, False)
    assert "heaters" not in means(1, False)  # the profile may keep some on


def test_a_stop_that_the_printer_hasn_t_confirmed_asks_to_cut_its_power() -> None:
    message = "emergency stop by the user; the printer has NOT confirmed: cut its power"
    alert = alert_of(Status(LinkState.KILLED, message=message, position_known=False), "", False)
    assert alert is not None
    assert "hasn't confirmed" in alert.what
    assert alert.remedy.startswith("Cut its power now.")
    assert "are off" not in alert.means


@pytest.mark.parametrize(
    ("status", "says", "not_said"),
    [
        (Status(LinkState.STOPPED, message="cancelled by the user before the first line"),
         "no line of the job", "lifted"),
        (Status(LinkState.FAILED, message="no firmware answers", error="HandshakeError"),
         "no line of the job", "lifted"),
        (Status(LinkState.STOPPED, message="stopped", position_known=False),
         "uncertain", "are off"),
        (Status(LinkState.INTERRUPTED, message="it was paused", position_known=False),
         "heaters stay as set", "in the part"),
        (Status(LinkState.FAILED, error="PortLost", position_known=False),
         "If powered", "in the part"),
    ],
)  # fmt: skip
def test_an_end_claims_nothing_that_was_not_done(status: Status, says: str, not_said: str) -> None:
    alert = alert_of(status, "", False)
    assert alert is not None
    assert says in alert.means
    assert not_said not in alert.means


@pytest.mark.parametrize(
    ("state", "words"),
    [
        ("printing", "X53.50 Y55.00 Z10.00"),
        ("pausing", "X53.50 Y55.00 Z10.00"),
        ("paused", "raised from X53.50 Y55.00 Z10.00"),
        ("resuming", "raised from X53.50 Y55.00 Z10.00"),
        ("stopped", "raised from about X53.50 Y55.00 Z10.00"),
        ("done", "X53.50 Y55.00 Z10.00"),
    ],
)
def test_a_tip_that_a_pause_or_a_stop_has_raised_is_not_said_to_be_in_the_part(
    state: str, words: str
) -> None:
    status = Status(LinkState(state))
    assert tip_words(status, PROGRESS, None) == words
    assert tip_words(Status(LinkState(state), position_known=False), PROGRESS, None) == ""


def test_the_tip_of_a_stopped_print_is_where_the_printer_said_it_stood(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "journal.log")
    journal.add("job", sha256="ab", started=1.0, id="one")
    journal.add("stood", done=3, line=2, place={"x": 107.46, "y": 50.0, "z": 10.4, "e": 1.0})
    journal.close()
    facts = read_journal_if_any(tmp_path / "journal.log")
    truth = assemble_state(tmp_path, Status(LinkState.STOPPED), facts)
    assert truth.words["tip"] == "raised from X107.46 Y50.00 Z10.40"
    assert facts.stood_mm != JournalledPrint().stood_mm
