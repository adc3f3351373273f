"""Late or bunched oks and slow boards: done is reported after the last motor step."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.states import LinkState
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.devices.faults import Fault, PermanentFaults
from sim.gcode.dry_run.run import dry_run
from tests.printctl.machine.link.simulated import PRINTER, START, gcode, printed, same_motion
from tests.printctl.machine.link.simulated_transport import SimulatedTransport
from tests.slower import first_of

MOVES = 40
LATE = Fault(fault="late_oks", line=30, seconds=5.0)
STALL = Fault(fault="stall", line=30, seconds=4.0)


def wire(*faults: Fault, seed: int = 0, **troubles: object) -> SimulatedTransport:
    return SimulatedTransport(
        MarlinPrinter(PRINTER, START, faults=faults),
        VirtualClock(),
        PermanentFaults.model_validate(troubles),
        np.random.default_rng(seed),
    )


def last_step_s(transport: SimulatedTransport) -> float:
    """When the motors stood, on the host's clock, s; all that was accepted is run first."""
    transport.printer.finish()
    board_s = float(transport.printer.executed().time_end[-1])
    return transport.printer.pace.host_time(board_s)


def check_print(transport: SimulatedTransport, folder: Path) -> None:
    """Print; done must be said behind the last step, and each move be made once."""
    data = gcode(MOVES)
    status, _ = printed(data, folder, transport)
    said_s = transport.clock.now()
    assert status.state is LinkState.DONE, status
    assert said_s >= last_step_s(transport)
    foreseen = dry_run(data, PRINTER, START, cold_extrusion=True).executed
    assert same_motion(transport.printer.executed(), foreseen)


@pytest.mark.parametrize("seed", first_of([0, 3, 1, 2]))
def test_each_ok_late_by_up_to_five_seconds(tmp_path, seed):
    check_print(wire(LATE, seed=seed), tmp_path)


@pytest.mark.parametrize(
    "delays", first_of([(0, 0, 0, 3), (3,), (0, 1.5, 0, 0, 1), (2, 0), (0, 0, 2), (0, 5)], 3)
)
def test_oks_that_come_bunched(tmp_path, delays):
    check_print(wire(ok_delays_s=delays), tmp_path)


@pytest.mark.parametrize("seed", first_of([0, 3]))
def test_all_answers_late_by_up_to_five_seconds_from_the_handshake_on(tmp_path, seed):
    """An answer to an earlier question is none to a later doubt's, and no sign of a reset."""
    check_print(wire(seed=seed, ok_delay_up_to_s=5.0), tmp_path)


def test_board_that_stands_still_for_four_seconds(tmp_path):
    transport = wire(STALL)
    check_print(transport, tmp_path)
    assert transport.printer.pace.host_time(transport.printer.now) > transport.printer.now + 3.9


@pytest.mark.parametrize("share", first_of([0.3, 0.5]))
def test_board_at_a_share_of_its_speed(tmp_path, share):
    transport = wire(speed=share)
    check_print(transport, tmp_path)
    assert transport.clock.now() > transport.printer.now / share * 0.99


def test_slow_board_that_stalls_behind_late_and_lost_oks(tmp_path):
    transport = wire(STALL, seed=3, speed=0.5, ok_delay_up_to_s=0.8, drop_ok=0.05)
    check_print(transport, tmp_path)
