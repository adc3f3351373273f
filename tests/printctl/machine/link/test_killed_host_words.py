"""Message about a print whose link process was killed: the printer's behaviour, by family."""

from __future__ import annotations

from contextlib import closing

import pytest

from printctl.cli.status import status_lines
from printctl.machine.link.find_link import read_outcome
from printctl.machine.link.journal import Journal
from printctl.machine.link.record import JOURNAL, RECORD, LinkRecord, save_private
from printctl.machine.link.states import LinkState
from printctl.machine.print_state.state import assemble_state
from printctl.machine.printing.journal_facts import JournalledFacts
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import layered


def killed(folder, profile: str, state: LinkState, done: int = 60, port: str = "/dev/printer"):
    job = folder / "job of mine.gcode"
    job.write_bytes(layered(4, 60))
    save_private(folder / RECORD, LinkRecord(1, "", "", str(job), profile, port, 1.0))
    with closing(Journal(folder / JOURNAL)) as journal:
        sha256 = parse_job(layered(4, 60), job.name).sha256
        journal.add("job", name=job.name, sha256=sha256, lines=300, started=1.0, pid=1)
        journal.add("state", state=LinkState.PRINTING, message="")
        journal.add("ack", done=done)
        if state is not LinkState.PRINTING:
            journal.add("state", state=state, message="")
    return read_outcome(folder)


@pytest.mark.parametrize(
    ("profile", "held"),
    [
        ("generic_marlin", "up to 20 moves"),
        ("klipper_bioprinter", "some seconds of moves"),
        ("makergear_m2_duet2", "moves (last"),
    ],
)
def test_motors_may_run_out_what_the_printer_has_taken(tmp_path, profile, held):
    message = killed(tmp_path, profile, LinkState.PRINTING).message
    assert "nothing has stopped its motors" in message
    assert held in message
    assert "heaters stay on" in message


def test_a_paused_printer_stands(tmp_path):
    assert "its motors stood" in killed(tmp_path, "generic_marlin", LinkState.PAUSED).message


def test_command_that_recovers_can_be_copied(tmp_path):
    status = killed(tmp_path, "generic_marlin", LinkState.PRINTING)
    (line,) = [
        line
        for line in status_lines(assemble_state(tmp_path, status, JournalledFacts()), "my run")
        if line.startswith("recover:")
    ]
    assert "printctl recover 'my run' --from-line " in line
    assert line.split("--from-line ")[1].split()[0].isdigit()
