"""Admit lines to a simulated board: from the receive ring to the command queue, or refused."""

from __future__ import annotations

from sim.devices.board.controller import Controller
from sim.devices.board.fault_effects import apply_fault
from sim.devices.board.lines import RefusedLine
from sim.devices.board.runner import Runner


class Intake:
    """Takes lines while the queue has room.

    Parameters
    ----------
    board : Controller
    runner : Runner
        Of what acts as it enters.
    """

    def __init__(self, board: Controller, runner: Runner) -> None:
        self._board, self._runner = board, runner

    def read_line(self) -> bool:
        """Move one line from the ring to the queue, or refuse it; whether there was one."""
        board = self._board
        board.firmware.look_at(board.wire.ring)
        if len(board.work.queue) >= board.machine.printer.command_queue:
            return False
        line = board.reader.next_line(board.wire.ring)
        if line is None:
            return False
        before = board.lines.last_number
        accepted = board.lines.accept(line)
        if isinstance(accepted, RefusedLine):
            board.firmware.refuse(accepted.reason)
        elif accepted is not None:
            self._take(accepted, before)
        return True

    def _take(self, line: bytes, last_number: int) -> None:
        board = self._board
        number = board.lines.last_number
        fault = board.plan.at_line(number) if number != last_number else None
        if fault is not None and apply_fault(board, fault):
            return
        board.work.queue.append(line)
        code = board.firmware.urgent_code(line)
        if code is not None:
            self.act_urgently(code)

    def act_urgently(self, code: bytes) -> None:
        """Have the firmware do what an urgent code asks for, before the command in hand goes on."""
        self._runner.begin(self._board.firmware.act_urgently(code), answers=False)
