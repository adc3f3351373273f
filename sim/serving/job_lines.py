"""Match each line that the simulated printer receives to its command in the job's file, by text.

A host puts in lines of its own (a checkpoint's question, a pause's lift), which have numbers too,
so that a line's number alone doesn't tell the file's command. The text does: a host sends the
file's commands in the file's order, and a line that isn't the next of them is the host's own.
"""

from __future__ import annotations

import re
from typing import Final

from firmware_profiles import Printer
from sim.errors import LineError
from sim.reading import read_line
from sim.reading.file import read_file

_NUMBERED: Final = re.compile(rb"(?:N\d+ *)?(.*?) *(?:\*\d*)?$", re.DOTALL)
_BEGINS: Final = re.compile(rb"(?:N-?\d+ *)?M0*110(?!\d)")
OWN: Final = -1


class JobLines:
    """The file's commands, and which of them comes next.

    Parameters
    ----------
    gcode : bytes
        The file.
    printer : Printer
        Whose firmware family says how a line is read.
    """

    def __init__(self, gcode: bytes, printer: Printer) -> None:
        self._commands = [command for command in read_file(gcode, printer).lines if command]
        self._printer = printer
        self._next = 0

    def find(self, line: bytes) -> int:
        """Command of the file, from 0, that a line is, with number and checksum or without.

        -1 for a host's own. A move by hand that happens to be the file's next one is taken for it.
        """
        at = self._next
        found = _NUMBERED.match(line.rstrip())
        if found is None or at >= len(self._commands):
            return OWN
        wanted = self._commands[at]
        return at if found[1] == wanted or self._sent(found[1]) == wanted else OWN

    def take(self, line: bytes) -> int:
        """The same, for a line that is done now: the next command of the file follows it."""
        if _BEGINS.match(line):  # the lines are numbered anew: a print begins
            self._next = 0
            return OWN
        found = self.find(line)
        if found != OWN:
            self._next = found + 1
        return found

    def _sent(self, command: bytes) -> bytes:
        """As our link would send it; what can't be read is a host's own."""
        try:
            return read_line(command, self._printer).text
        except LineError:
            return b""
