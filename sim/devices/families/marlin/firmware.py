"""Class that plugs Marlin into the simulated board: messages, command dispatch, kill."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import ClassVar

from sim.devices.board.controller import Controller, Handlers
from sim.devices.board.heat import HeatFault
from sim.devices.board.lines import Numbering
from sim.devices.board.machine import Machine, MotorRunOn
from sim.devices.board.moves import move
from sim.devices.board.waits import Steps, Wait
from sim.devices.families.marlin.commands import HANDLERS
from sim.devices.families.marlin.halt import WaitForWords
from sim.devices.families.marlin.numbering import MarlinNumbering, request_resend
from sim.devices.families.marlin.plain_moves import take_plain_moves
from sim.devices.families.marlin.report_commands import ok_words, planned_position, temperatures
from sim.devices.families.marlin.texts import BANNER
from sim.devices.families.marlin.tools import m218, take_tool
from sim.devices.families.marlin.urgent import EMERGENCY, act_urgently, code_on_entering
from sim.devices.families.marlin.waits import m420
from sim.gcode.program.gcode import Command

_HEAT_WORDS = {
    HeatFault.SENSOR: ("MINTEMP triggered", "Err: MINTEMP"),
    HeatFault.RUNAWAY: ("Thermal Runaway", "THERMAL RUNAWAY"),
}


class Marlin:
    """See the module and `sim.devices.board.firmware.Firmware`.

    Parameters
    ----------
    board : Controller
        The one that it runs on.

    Attributes
    ----------
    handlers : mapping of str to function
        Commands that it knows.
    offsets_by : str
        The command that tells offsets of heads.
    """

    handlers: ClassVar[Handlers] = HANDLERS
    offsets_by: ClassVar[str] = "M218"
    banner: ClassVar[tuple[str, ...]] = BANNER
    too_cold_words: ClassVar[str] = "echo: cold extrusion prevented"
    too_long_words: ClassVar[str] = "echo: too long extrusion prevented"
    bad_arc_words: ClassVar[str] = "Error:G2/G3 bad parameters"

    def __init__(self, board: Controller) -> None:
        self.board = board

    # -- lines

    def urgent_pattern(self) -> re.Pattern[bytes] | None:
        """The emergency parser's, where the profile says that there is one."""
        return EMERGENCY if self.board.machine.printer.emergency_parser else None

    def numbering(self) -> Numbering:
        """Numbers with checksums."""
        return MarlinNumbering()

    def look_at(self, ring: bytearray) -> None:
        """Do nothing: a line is read when it is whole."""

    def refuse(self, reason: bytes) -> None:
        """Tell why, and ask for the line again."""
        last = self.board.lines.last_number
        self.board.machine.say(f"Error:{reason.decode()}, Last Line: {last}")
        request_resend(self.board)

    def urgent_code(self, line: bytes) -> bytes | None:
        """M112, M410 and M108 act when they enter the queue, but for an emergency parser."""
        return None if self.board.machine.printer.emergency_parser else code_on_entering(line)

    def act_urgently(self, code: bytes) -> Steps:
        """Kill, end a wait or stop."""
        return act_urgently(self.board, code)

    # -- commands

    def take_at_once(self, data: bytes, alarm: Callable[[], float]) -> bytes:
        """Take the plain next lines of a print."""
        return take_plain_moves(self.board, data, alarm)

    def start(self, command: Command) -> Steps:
        """Begin a command; one that isn't known is told."""
        printer = self.board.machine.printer
        if command.letter == "G" and command.number <= 3:
            return move(self.board)
        if command.letter == "T":
            return self.take_tool(command)
        name = f"{command.letter}{command.number}"
        if name in self.handlers:
            return self.handlers[name](self.board, command)
        if name == "M420" and self.board.machine.board.bed_slope:
            return m420(self.board, command)
        if name == self.offsets_by and printer.head_count > 1:
            m218(self.board, command)
        elif name not in printer.extra_commands:
            self.say_unknown(command)
        return None

    def take_tool(self, command: Command) -> Steps:
        """T: another head."""
        return take_tool(self.board, command)

    def say_unknown(self, command: Command) -> None:
        """There is no such command."""
        self.board.machine.say(b'echo:Unknown command: "' + command.text + b'"')

    def echo(self, line: bytes) -> None:
        """Say the line that begins, after M111 S1."""
        if self.board.machine.debug & 1:
            self.board.machine.say("echo:" + line.decode("latin-1"), b"\r\n")

    def ok_words(self) -> str:
        """With ADVANCED_OK numbers and places."""
        return ok_words(self.board)

    # -- said by the clock

    def say_busy(self, wait: Wait) -> None:
        """The keepalive."""
        self.board.machine.say(f"echo:busy: {'paused for user' if wait.for_user else 'processing'}")

    def report_temperatures(self) -> None:
        """As M155 asked for."""
        self.board.machine.say(temperatures(self.board.machine))

    def report_position(self) -> None:
        """As M154 asked for."""
        self.board.machine.say(planned_position(self.board))

    # -- ends

    def power_up(self) -> None:
        """Begin with the board's own values."""

    def idle_is_over(self) -> None:
        """Kill itself (M85)."""
        self.board.machine.say(
            "Error:!! KILL caused by too much inactive time - current command: "
            + self.board.work.line.decode("latin-1")
        )
        self.board.kill("KILLED.")

    def fail_heat(self, fault: HeatFault) -> None:
        """Tell a heater's fault, and kill itself."""
        error, reason = _HEAT_WORDS[fault]
        self.board.machine.say(f"Error:{error}, system stopped! Heater_ID: E0")
        self.board.kill(reason)

    def say_halted(self, reason: str) -> None:
        """It stops for good."""
        self.board.machine.say(f"echo:{reason}")
        self.board.machine.say("Error:Printer halted. kill() called!")
        self.board.machine.say("//action:poweroff")

    def run_on(self) -> Callable[[Machine], MotorRunOn] | None:
        """For as long as it waits for its words to get out."""
        return WaitForWords

    def answer_unserved(self, waiting: list[bytes]) -> None:
        """Do nothing: what waited is lost."""

    def hear_dead(self) -> None:
        """Take what comes after a halt: nothing is heard."""
        self.board.wire.flush()
