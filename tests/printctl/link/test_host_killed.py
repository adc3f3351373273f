"""Host death during a print on the simulated printer, and resumption."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from firmware_profiles.families.marlin.protocol import MarlinProtocol
from printctl.link.clock import VirtualClock
from printctl.link.journalled_print import read_journal
from printctl.link.states import LinkState, Status
from printctl.link.streamer import Streamer
from printctl.link.wiring import Wiring
from sim.dry_run.run import dry_run
from sim.families.marlin.printer import MarlinPrinter
from tests.printctl.link.jobs import parse_job
from tests.printctl.link.journals import journal_in
from tests.printctl.link.layered import doomed
from tests.printctl.link.sim_transport import SimTransport
from tests.printctl.link.simulated import PRINTER, START, gcode, printed, wire
from tests.printctl.link.simulated_transport import HostDiedError
from tests.slower import first_of


def resumed(data: bytes, folder: Path, transport: SimTransport) -> Status:
    history = read_journal(folder / "journal.log")
    wiring = Wiring(
        transport=transport,
        protocol=MarlinProtocol(),
        clock=transport.clock,
        journal=journal_in(folder),
        printer=PRINTER,
    )
    return Streamer(wiring, parse_job(data, "test.gcode")).run(history)


def test_host_killed_in_a_pause_comes_down_and_primes_again(tmp_path):
    data, transport = gcode(300), wire()
    at: list[Streamer] = []

    def on_status(status: Status) -> None:
        if status.state is LinkState.PRINTING and status.lines_done > 50:
            at[0].pause()
        if status.state is LinkState.PAUSED:
            raise HostDiedError

    wiring = Wiring(
        transport=transport,
        protocol=MarlinProtocol(),
        clock=transport.clock,
        journal=journal_in(tmp_path),
        printer=PRINTER,
        on_status=on_status,
    )
    at.append(Streamer(wiring, parse_job(data, "test.gcode")))
    with pytest.raises(HostDiedError):
        at[0].run()
    lifted = transport.printer.executed().end[-1]
    assert lifted[2] == pytest.approx(30.0)
    status = resumed(data, tmp_path, SimTransport(transport.printer, transport.clock))
    assert status.state is LinkState.DONE, status
    motion = transport.printer.executed()
    foreseen = dry_run(data, PRINTER, START, cold_extrusion=True).executed
    assert np.array_equal(motion.end[-1], foreseen.end[-1])
    assert motion.plunger_end[-1] == foreseen.plunger_end[-1]
    assert len(motion) == len(foreseen) + 13  # relieve, lift, ten steps down, prime


def test_printer_reset_while_the_host_was_dead_is_position_unknown(tmp_path):
    data, printer, clock = gcode(60), MarlinPrinter(PRINTER, START), VirtualClock()
    with pytest.raises(HostDiedError):
        printed(data, tmp_path, doomed(printer, clock, 60, 1.0))
    printer.reset()
    printer.settle()
    printer.take_output()
    before = len(printer.executed())
    status = resumed(data, tmp_path, SimTransport(printer, clock))
    assert status.state is LinkState.POSITION_UNKNOWN
    assert len(printer.executed()) == before


@pytest.mark.parametrize("seed", first_of(range(25), 6))
def test_host_killed_twice_at_random_moments_goes_on_exactly(tmp_path, seed):
    rng = np.random.default_rng(seed)
    data, printer, clock = gcode(60), MarlinPrinter(PRINTER, START), VirtualClock()
    transport, last, part = SimTransport(printer, clock), int(rng.integers(1, 60)), rng.random()

    def arm(status: Status) -> None:
        if status.state is LinkState.PRINTING and status.lines_done == 0:
            transport.die_at(last, part)

    with pytest.raises(HostDiedError):
        printed(data, tmp_path, transport, on_status=arm)
    with pytest.raises(HostDiedError):
        resumed(data, tmp_path, doomed(printer, clock, int(rng.integers(1, 9)), 0.5))
    status = resumed(data, tmp_path, SimTransport(printer, clock))
    assert status.state is LinkState.DONE, status
    motion = printer.executed()
    foreseen = dry_run(data, PRINTER, START, cold_extrusion=True).executed
    assert np.array_equal(motion.end, foreseen.end)
    assert np.array_equal(motion.plunger_end, foreseen.plunger_end)


@pytest.mark.parametrize("place", [b"Z15", b"Z5", b"X57"])
@pytest.mark.parametrize("last", [45, 90])
def test_place_renamed_while_the_host_was_dead_is_position_unknown(tmp_path, place, last):
    data, printer, clock = gcode(60), MarlinPrinter(PRINTER, START), VirtualClock()
    with pytest.raises(HostDiedError):
        printed(data, tmp_path, doomed(printer, clock, last, 1.0))
    printer.settle()
    printer.exchange(b"\nG92 " + place + b"\n")
    printer.take_output()
    before = printer.machine.motion.planner["position"][0].tolist()
    status = resumed(data, tmp_path, SimTransport(printer, clock))
    assert status.state is LinkState.POSITION_UNKNOWN
    assert f"{place[:1].decode()} is called" in status.message
    assert printer.machine.motion.planner["position"][0].tolist() == before


@pytest.mark.parametrize("other", [b"G91\n", b"M83\n", b"M221 S50\n", b"M140 S60\n"])
def test_what_another_program_set_while_the_host_was_dead_is_taken_back(tmp_path, other):
    data, printer, clock = gcode(60), MarlinPrinter(PRINTER, START), VirtualClock()
    with pytest.raises(HostDiedError):
        printed(data, tmp_path, doomed(printer, clock, 60, 1.0))
    printer.receive(other)
    printer.settle()
    printer.take_output()
    status = resumed(data, tmp_path, SimTransport(printer, clock))
    assert status.state is LinkState.DONE, status
    motion = printer.executed()
    foreseen = dry_run(data, PRINTER, START, cold_extrusion=True).executed
    assert np.array_equal(motion.end[-1], foreseen.end[-1])
    assert motion.plunger_end[-1] == pytest.approx(foreseen.plunger_end[-1])
    assert printer.machine.heat.bed.target_c == 0
