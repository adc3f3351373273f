"""Following a print from the command line."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console

from printctl.machine.link.journal import Journal
from printctl.machine.link.record import JOURNAL
from printctl.machine.link.states import LinkState, PrintOutcome, Status
from printctl.machine.link.syringe_change import CHANGE
from printctl.machine.printing.watch import follow
from printctl.progress import StageBars


class Told:
    """A client of a print whose board disagrees twice with the profile."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def events(self) -> Iterator[Status]:
        journal = Journal(self.folder / JOURNAL)
        journal.add("job", sha256="a", started=0.0)
        for count, text in enumerate(("M204 R is 500", "M203 X is 90"), 1):
            journal.add("alarm", text=text)
            yield Status(LinkState.PRINTING, lines_total=5, alarms=count)
            yield Status(LinkState.PRINTING, lines_done=count, lines_total=5, alarms=count)
        journal.close()

    def wait(self) -> PrintOutcome:
        return PrintOutcome(LinkState.DONE, 5, 5, "all 5 lines done")


def test_each_alarm_is_said_in_words_while_a_print_is_followed(tmp_path):
    screen = io.StringIO()
    bars = StageBars(Console(file=screen, width=200))
    with bars.all(), bars.stage("print") as report:
        follow(Told(tmp_path), report, bars)
    assert screen.getvalue().splitlines() == [
        "print          note: 1 alarm: M204 R is 500",
        "print          note: 2 alarms, the last: M203 X is 90",
    ]


class Held(Told):
    """A client of a print that is held for a syringe, twice asked, then for a person's pause."""

    def events(self) -> Iterator[Status]:
        change = f"paused at line 7: {CHANGE}"
        yield Status(LinkState.PAUSING, message="the needle is lifted", lines_total=5)
        for _ in range(2):
            yield Status(LinkState.PAUSED, message=change, lines_total=5, waits_for="syringe")
        yield Status(LinkState.PRINTING, message="printing", lines_total=5)
        yield Status(LinkState.PAUSED, message="paused at line 9", lines_total=5)


def test_what_a_pause_waits_for_is_said_once_with_the_command_that_goes_on(tmp_path):
    screen = io.StringIO()
    bars = StageBars(Console(file=screen, width=2000))
    with bars.all(), bars.stage("print") as report:
        follow(Held(tmp_path), report, bars)
    syringe, pause = screen.getvalue().splitlines()
    assert "change the syringe" in syringe
    assert f"printctl resume {tmp_path} --plunger-mm" in syringe
    assert "paused at line 9" in pause
    assert f"printctl resume {tmp_path}`" in pause
