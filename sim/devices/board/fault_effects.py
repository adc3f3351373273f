"""Apply a planned fault to a simulated board: reset, kill, unplugging, lost ok, noise, stall."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from sim.devices.board.controller import Controller
from sim.devices.board.heat import HeatFault
from sim.devices.faults.fault_file import Fault, FaultKind


def apply_fault(board: Controller, fault: Fault) -> bool:
    """Let a fault happen; True when the board forgets what it was doing."""
    _HAPPENINGS[fault.fault](board, fault)
    return fault.fault in ("reset", "kill")


def _reset(board: Controller, fault: Fault) -> None:
    board.reset()


def _kill(board: Controller, fault: Fault) -> None:
    board.firmware.fail_heat(HeatFault.RUNAWAY)


def _unplug(board: Controller, fault: Fault) -> None:
    board.unplugged, board.back_after_s = True, fault.back_after_s


def _runaway(board: Controller, fault: Fault) -> None:
    board.machine.heat.hotend.lose_power(board.machine.now)


def _drop_ok(board: Controller, fault: Fault) -> None:
    board.plan.muted.add(fault.line or 0)


def _noise(board: Controller, fault: Fault) -> None:
    board.bad_line.burst(fault.rate or 0.0, fault.length_bytes or 0)


def _delay(board: Controller, fault: Fault) -> None:
    board.bad_line.hold(fault.seconds or 0.0)


def _late_oks(board: Controller, fault: Fault) -> None:
    board.bad_line.delay_oks(fault.seconds or 0.0)


def _stall(board: Controller, fault: Fault) -> None:
    board.pace.freeze(board.machine.now, fault.seconds or 0.0)


def _slow(board: Controller, fault: Fault) -> None:
    board.pace.set_share(board.machine.now, fault.share or 1.0)


def _endstop(board: Controller, fault: Fault) -> None:
    board.machine.stuck["xyz".index(fault.axis or "x")] = fault.stuck or "open"


_HAPPENINGS: Final[dict[FaultKind, Callable[[Controller, Fault], None]]] = {
    "reset": _reset,
    "kill": _kill,
    "unplug": _unplug,
    "runaway": _runaway,
    "drop_ok": _drop_ok,
    "noise": _noise,
    "delay": _delay,
    "late_oks": _late_oks,
    "stall": _stall,
    "slow": _slow,
    "endstop_stuck": _endstop,
}
