"""Interface of a firmware family on a simulated board: messages, commands, line numbers, kill."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import ClassVar, Protocol

from sim.devices.board.heaters import HeatFault
from sim.devices.board.machine import Machine, MotorRunOn
from sim.devices.board.waits import Steps, Wait
from sim.devices.board.wire import Numbering
from sim.gcode.program.gcode import Command


class Firmware(Protocol):
    """A family's own part; it is made for one board and knows that board.

    Attributes
    ----------
    banner : tuple of str
        Said after a reset.
    too_cold_words, too_long_words : str
        Said where the plunger's part of a move is dropped.
    bad_arc_words : str
        Said to an arc that can't be made.
    """

    banner: ClassVar[tuple[str, ...]]
    too_cold_words: ClassVar[str]
    too_long_words: ClassVar[str]
    bad_arc_words: ClassVar[str]

    # -- lines

    def urgent_pattern(self) -> re.Pattern[bytes] | None:
        """Begin of a line that acts as its bytes arrive; None where none does."""

    def numbering(self) -> Numbering:
        """A new reader of line numbers and checksums."""

    def look_at(self, ring: bytearray) -> None:
        """Look at the received bytes before the next line is cut from them."""

    def refuse(self, reason: bytes) -> None:
        """Tell that a line wasn't taken, and what to do about it."""

    def urgent_code(self, line: bytes) -> bytes | None:
        """Code of a line that acts as it enters the queue."""

    def act_urgently(self, code: bytes) -> Steps:
        """Do what an urgent code asks for."""

    # -- commands

    def take_at_once(self, data: bytes, alarm: Callable[[], float]) -> bytes:
        """Take what needs no main loop from the front of ``data``; return what is left.

        ``alarm`` tells when the main loop next has something to do of its own, s.
        """

    def start(self, command: Command) -> Steps:
        """Begin a command."""

    def echo(self, line: bytes) -> None:
        """Say the line that begins, where the firmware was told to."""

    def ok_words(self) -> str:
        """Words behind the present command's ok."""

    # -- said by the clock

    def say_busy(self, wait: Wait) -> None:
        """Tell that a command is under way."""

    def report_temperatures(self) -> None:
        """Tell the temperatures unasked."""

    def report_position(self) -> None:
        """Tell the position unasked."""

    # -- ends

    def power_up(self) -> None:
        """Set what this firmware begins with, after the board has forgotten everything."""

    def idle_is_over(self) -> None:
        """Act where nothing has moved for longer than the firmware was told to bear."""

    def fail_heat(self, fault: HeatFault) -> None:
        """Tell a heater's fault, and stop for good."""

    def say_halted(self, reason: str) -> None:
        """Tell that it stops for good."""

    def run_on(self) -> Callable[[Machine], MotorRunOn] | None:
        """What makes the time that motors run on after a kill; None where they stop at once."""

    def answer_unserved(self, waiting: list[bytes]) -> None:
        """Answer the lines that waited when it was killed, if it does."""

    def hear_dead(self) -> None:
        """Take what comes after a halt."""
