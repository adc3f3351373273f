"""Assignment of executed blocks to G-code lines, despite lines inserted by a host."""

import numpy as np
import pytest

from firmware_profiles import Printer, load
from gcode.dry_run.run import dry_run
from printctl.machine.job.retreat import Retreat
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.records.journal import Journal
from printctl.machine.records.states import LinkState
from sim.devices.families.marlin_printer import MarlinPrinter
from sim.devices.serving.job_lines import JobLines
from tests.gcode.air_ink import pneumatic_deposit
from tests.printctl.machine.link import airy, layered
from tests.printctl.machine.link.layered import Script, played
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import START

PRINTER = load(Printer, "generic_marlin")
FILE = b"; a job\nG90\n\nG1 X1 (there) F600 ; over there\nM400\nG1 X2\n  M113 S1\nG1 X1\n"


def test_the_file_s_commands_are_found_in_their_order_and_all_else_is_the_host_s() -> None:
    job = JobLines(FILE, PRINTER)
    said = [b"N1 G90*12", b"N2 M0114*1", b"N3 G1 X1  F600*55\n", b"N4 G1 Z20*1", b"G1 X2",
            b"N5 M0400*9", b"N6 G1 X2*7", b"N7 M0113 S1*7", b"N8 G1 X1", b"N9 G1 X1*3"]  # fmt: skip
    assert [job.take(line) for line in said] == [0, -1, 1, -1, -1, 2, 3, 4, 5, -1]
    assert job.take(b"N0 M110 N0*125") == -1
    assert job.find(b"N1 G90*12") == job.take(b"N1 G90*12") == 0
    # An M400 of the host in place of the file's shifts nothing.
    job = JobLines(FILE, PRINTER)
    said = [b"G90", b"G1 X1  F600", b"M400", b"M400", b"M114", b"G1 X2"]
    assert [job.take(line) for line in said] == [0, 1, 2, -1, -1, 3]


@pytest.mark.parametrize("slow", [False, True])
def test_pauses_and_checkpoints_leave_each_block_its_command(tmp_path, slow) -> None:
    data = layered.layered(3, 20)
    printer = MarlinPrinter(PRINTER, START)
    printer.job = JobLines(data, PRINTER)
    if slow:
        printer.firmware.take_at_once = lambda waiting, alarm: waiting  # type: ignore[method-assign]
    transport, script = SimTransport(printer, VirtualClock()), Script()
    read, moments = transport.read, [15, 30, 50]

    def reading(timeout: float) -> bytes:
        streamer = script.streamer
        printing = streamer is not None and streamer.status.state is LinkState.PRINTING
        if moments and printing and streamer.status.lines_done >= moments[0]:
            moments.pop(0)
            streamer.pause()
        return read(timeout)

    transport.read = reading  # type: ignore[method-assign]
    status = played(data, tmp_path, transport, script, retreat=Retreat(lift_mm=30))
    assert status.state is LinkState.DONE
    assert len(script.pauses) == 3
    foreseen = dry_run(data, PRINTER, START, cold_extrusion=True).executed
    motion = printer.executed()
    own = motion.line < 0
    assert 6 <= np.count_nonzero(own) == len(motion) - len(foreseen)
    assert motion.line[~own].tolist() == foreseen.line.tolist()
    np.testing.assert_array_equal(motion.end[~own], foreseen.end)


def test_ink_of_a_print_with_checkpoints_lies_by_the_lines_that_came(tmp_path) -> None:
    data = airy.airy(2, 12)
    printer = MarlinPrinter(airy.AIR, airy.START)
    printer.job = JobLines(data, PRINTER)
    script = Script(at_line={})
    status = played(data, tmp_path, SimTransport(printer, VirtualClock()), script, printer=airy.AIR)
    assert status.state is LinkState.DONE
    foreseen = dry_run(data, airy.AIR, airy.START).executed
    assert printer.executed().line.tolist() == foreseen.line.tolist()
    laid = [pneumatic_deposit(m, data, airy.AIR, 0.05, 0.1) for m in (printer.executed(), foreseen)]
    np.testing.assert_array_equal(laid[0].volume, laid[1].volume)


def test_lines_that_the_journal_says_were_inserted_are_the_jobs_from_then_on(tmp_path):
    """The journal is written by `machine.records.journal`; the simulated printer only reads it."""
    own = [b"G1 X1 Y1 F600", b"G1 X2 Y1", b"G1 X3 Y1"]
    put_in = [b"G1 Y2", b"G1 Y1"]
    journal = Journal(tmp_path / "journal.log")
    job = JobLines(b"\n".join(own) + b"\n", PRINTER, tmp_path / "journal.log")
    assert [job.take(b"N1 M110*1"), job.take(own[0]), job.take(b"G1 Z30.00000 F300")] == [-1, 0, -1]
    assert job.take(put_in[0]) == -1  # by hand: nothing is inserted yet
    journal.add("insert", look=1, after=1, lines=[one.decode() for one in put_in])
    assert [job.take(one) for one in (*put_in, *own[1:])] == [1, 2, 3, 4]
    job.take(b"M110 N0")
    (tmp_path / "journal.log").unlink()
    assert [job.take(one) for one in own] == [0, 1, 2]
    journal.close()


def test_lines_whose_doses_an_observer_has_corrected_are_told_as_well(tmp_path):
    own = [b"G92 E0", b"G1 X1 E1 F600", b"G1 E0.5", b"G1 E1", b"G1 X2 E2", b"G92 E0", b"G1 X3 E1"]
    sent = [b"G1 E0.50000", b"G1 E1.00000", b"G1 X2 E2.50000", b"G92 E0", b"G1 X3 E1.50000"]
    journal = Journal(tmp_path / "journal.log")
    job = JobLines(b"\n".join(own) + b"\n", PRINTER, tmp_path / "journal.log")
    assert [job.take(one) for one in own[:2]] == [0, 1]
    journal.add("insert", look=1, after=2, lines=[], flow=1.5)
    assert [job.take(one) for one in sent] == [2, 3, 4, 5, 6]
    journal.close()
