"""Following a print from the command line."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console

from printctl.link.journal import Journal
from printctl.link.record import JOURNAL
from printctl.link.states import LinkState, PrintOutcome, Status
from printctl.printing.watch import follow
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
