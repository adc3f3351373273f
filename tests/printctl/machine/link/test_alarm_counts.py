"""Repeated alarms are counted; whoever stopped a print is reported."""

from __future__ import annotations

from contextlib import closing

from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.history_entry import entry_of
from printctl.machine.link.journal import Journal
from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.states import LinkState
from printctl.machine.printing.journal_facts import read_journal_facts
from sim.devices.families.marlin.printer import MarlinPrinter
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import PRINTER, START, gcode, printed


class Doubled(SimTransport):
    """A bridge that repeats each of the printer's answers."""

    def __init__(self) -> None:
        super().__init__(MarlinPrinter(PRINTER, START), VirtualClock())
        self._rest = b""

    def read(self, timeout: float) -> bytes:
        whole, end, self._rest = (self._rest + super().read(timeout)).rpartition(b"\n")
        lines = (whole + end).splitlines(keepends=True)
        return b"".join(line * 2 if line.startswith(b"ok") else line for line in lines)


def test_answers_that_are_all_doubled_make_one_alarm_with_a_count(tmp_path):
    status, _ = printed(gcode(60), tmp_path, Doubled())
    assert status.state is LinkState.DONE
    assert status.alarms == 1
    journal = tmp_path / "journal.log"
    (text,) = read_journal(journal).alarms
    times = int(text.rsplit("(", 1)[1].removesuffix(" times)"))
    assert times > 30
    assert "another program or noise wrote to this printer" in text
    assert read_journal_facts(journal).last_alarm == text
    assert journal.read_text().count(" alarm") + journal.read_text().count('"repeated"') < 12


def test_history_tells_an_alarm_once(tmp_path):
    path = tmp_path / "journal.log"
    with closing(Journal(path)) as journal:
        journal.add("job", name="a.gcode", started=1.0, lines=3)
        journal.add("alarm", text="1 ok too many")
        journal.add("alarm", text="too warm")
        journal.add("repeated", first="1 ok too many", text="2 oks too many", times=2)
        journal.add("repeated", first="1 ok too many", text="9 oks too many", times=8)
    entry = entry_of(path)
    assert entry is not None
    texts = ["9 oks too many (8 times)", "too warm"]
    assert [alarm.text for alarm in entry.alarms] == read_journal(path).alarms == texts


class Cancelling(SimTransport):
    """A board on which somebody presses Cancel."""

    def __init__(self) -> None:
        super().__init__(MarlinPrinter(PRINTER, START), VirtualClock())
        self._pressed = False

    def read(self, timeout: float) -> bytes:
        said = super().read(timeout)
        if self.clock.now() > 2.0 and not self._pressed and said.endswith(b"\n"):
            self._pressed = True
            return said + b"//action:cancel\n"
        return said


def test_a_cancel_of_the_board_is_told_as_the_boards(tmp_path):
    status, _ = printed(gcode(400), tmp_path, Cancelling())
    assert status.state is LinkState.STOPPED
    assert "stopped by the printer (//action:cancel)" in status.message
