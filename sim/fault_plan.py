"""Which fault of the simulated firmware is due when, and what it does."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Final

from sim.faults import Fault, FaultKind

if TYPE_CHECKING:
    from sim.marlin_loop import MainLoop


class FaultPlan:
    """Faults that are still to come; each comes once.

    Attributes
    ----------
    next_s : float, s
        When the next one by the clock is due; infinite for none.
    muted : set of int
        Lines whose ok will be lost.
    """

    def __init__(self, faults: Iterable[Fault] = ()) -> None:
        every = list(faults)
        self.muted: set[int] = set()
        self._by_line = {fault.line: fault for fault in every if fault.line is not None}
        timed = [(fault.time_s, fault) for fault in every if fault.time_s is not None]
        self._by_time = sorted(timed, key=lambda one: one[0], reverse=True)
        counted = [(fault.bytes, fault) for fault in every if fault.bytes is not None]
        self._by_bytes = sorted(counted, key=lambda one: one[0], reverse=True)

    @property
    def next_s(self) -> float:
        """See the class."""
        return self._by_time[-1][0] if self._by_time else math.inf

    @property
    def counts_bytes(self) -> bool:
        """Whether one waits for a number of bytes."""
        return bool(self._by_bytes)

    def has_line(self, number: int) -> bool:
        """Whether one waits for this line."""
        return number in self._by_line

    def at_line(self, number: int) -> Fault | None:
        """The one that waits for this line."""
        return self._by_line.pop(number, None)

    def is_mute(self, number: int | None) -> bool:
        """Whether a line's ok is to be lost; it is lost once."""
        mute = number in self.muted
        self.muted.discard(number or 0)
        return mute

    def due(self, now: float, received: int) -> Fault | None:
        """The next one that is due by clock (s) or bytes received."""
        if self._by_time and self._by_time[-1][0] <= now:
            return self._by_time.pop()[1]
        if self._by_bytes and self._by_bytes[-1][0] <= received:
            return self._by_bytes.pop()[1]
        return None


def happen(board: MainLoop, fault: Fault) -> bool:
    """Let a fault happen; True when the board forgets what it was doing."""
    _HAPPENINGS[fault.fault](board, fault)
    return fault.fault in ("reset", "kill")


def _reset(board: MainLoop, fault: Fault) -> None:
    board.reset()


def _kill(board: MainLoop, fault: Fault) -> None:
    board.machine.say("Error:Thermal Runaway, system stopped! Heater_ID: E0")
    board.kill("THERMAL RUNAWAY")


def _unplug(board: MainLoop, fault: Fault) -> None:
    board.unplugged, board.back_after_s = True, fault.back_after_s


def _runaway(board: MainLoop, fault: Fault) -> None:
    board.machine.hotend.lose_power(board.machine.now)


def _drop_ok(board: MainLoop, fault: Fault) -> None:
    board.plan.muted.add(fault.line or 0)


def _noise(board: MainLoop, fault: Fault) -> None:
    board.bad_line.burst(fault.rate or 0.0, fault.length_bytes or 0)


def _delay(board: MainLoop, fault: Fault) -> None:
    board.bad_line.hold(fault.seconds or 0.0)


def _late_oks(board: MainLoop, fault: Fault) -> None:
    board.bad_line.delay_oks(fault.seconds or 0.0)


def _stall(board: MainLoop, fault: Fault) -> None:
    board.pace.freeze(board.machine.now, fault.seconds or 0.0)


def _slow(board: MainLoop, fault: Fault) -> None:
    board.pace.set_share(board.machine.now, fault.share or 1.0)


def _endstop(board: MainLoop, fault: Fault) -> None:
    board.machine.stuck["xyz".index(fault.axis or "x")] = fault.stuck or "open"


_HAPPENINGS: Final[dict[FaultKind, Callable[[MainLoop, Fault], None]]] = {
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
