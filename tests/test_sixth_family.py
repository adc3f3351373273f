"""Adding a sixth firmware family: two folders suffice for all parts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from design.toolpath.fresh import FreshOptions
from design.toolpath.gcode import GcodeOptions, write_gcode
from firmware_profiles import Printer, Syringe, load
from firmware_profiles.families import family_names
from gcode.dry_run.run import dry_run
from gcode.errors import LineError
from gcode.reading import read_line
from gcode.reading.line import is_known_line
from printctl.checks.gate import Bounds, LineOrigin, PrinterSituation, judge
from printctl.checks.gate.inputs import AllowedLine
from printctl.checks.preflight.firmware import firmware_checks
from printctl.machine.control.board.connecting import protocol_for
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.records.journal import Journal
from printctl.machine.records.states import LinkState
from sim.devices.families.registry import simulated_printer
from tests.design.toolpath.plans import fresh_toolpath
from tests.design.toolpath.shapes import as_solid, block
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.sixth_family import NAME, installed

START = (50.0, 60.0, 30.0)


@pytest.fixture(scope="module")
def printer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Printer]:
    with installed(tmp_path_factory.mktemp("sixth")) as found:
        yield found


def job(printer: Printer) -> bytes:
    toolpath = fresh_toolpath(as_solid(block(2, 2, 0.18)), FreshOptions())
    options = GcodeOptions(start_mm=START)
    return write_gcode(toolpath, printer, load(Syringe, "hamilton_1ml"), START, options).data


def test_it_is_found_by_its_folder(printer: Printer) -> None:
    assert printer.firmware == NAME
    assert NAME in family_names()


def test_lines_are_read_as_it_reads_them(printer: Printer) -> None:
    assert is_known_line(printer, read_line(b"M777", printer))
    assert not is_known_line(printer, read_line(b"G2 X1 Y1 I1 J1", printer))
    with pytest.raises(LineError, match=f"{NAME} reads capitals only"):
        read_line(b"m777", printer)


def test_the_gate_has_its_question(printer: Printer) -> None:
    known = PrinterSituation(Bounds(printer))
    assert isinstance(judge("M777", LineOrigin.CONSOLE, known), AllowedLine)
    assert not isinstance(judge("M777", LineOrigin.JOB, known), AllowedLine)
    assert not isinstance(judge("M503", LineOrigin.CONSOLE, known), AllowedLine)


def test_its_job_passes_dry_run_and_preflight(printer: Printer) -> None:
    run = dry_run(job(printer), printer, START)
    assert not run.findings
    assert all(check.passed for check in firmware_checks(run, printer))
    assert dry_run(b"M85 S600\nM300\n", printer, START).findings


def test_a_print_runs_on_its_twin(printer: Printer, tmp_path: Path) -> None:
    clock = VirtualClock()
    twin = simulated_printer(printer)(printer, START)
    transport = SimTransport(twin, clock, np.random.default_rng(1))
    wiring = Wiring(
        transport=transport,
        protocol=protocol_for(printer, 0.05),
        clock=clock,
        journal=Journal(tmp_path / "journal.log"),
        printer=printer,
    )
    assert type(wiring.protocol).__name__ == "SixthProtocol"
    status = Streamer(wiring, parse_job(job(printer), "part.gcode", printer)).run()
    assert status.state is LinkState.DONE, status
