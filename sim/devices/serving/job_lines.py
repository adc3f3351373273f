"""Match each line that the simulated printer receives to its command in the job, by text.

A host puts in lines of its own (a checkpoint's question, a pause's lift), which have numbers too,
so that a line's number alone doesn't tell the job's command. The text does: a host sends the
job's commands in the job's order, and a line that isn't the next of them is the host's own.

A job may grow while it is printed: an observer inserts a mend. The host writes an insert into its
journal before it sends the first line of it. So where a line isn't the next command, the journal is
looked at, and the commands are those of the grown job from there on.
"""

from __future__ import annotations

import json
import re
import zlib
from pathlib import Path
from typing import Final, NamedTuple

from firmware_profiles import Printer
from gcode.errors import LineError
from gcode.reading import read_line
from gcode.reading.file import read_file
from gcode.reading.read import plunger_count, with_flow

_NUMBERED: Final = re.compile(rb"(?:N\d+ *)?(.*?) *(?:\*\d*)?$", re.DOTALL)
_BEGINS: Final = re.compile(rb"(?:N-?\d+ *)?M0*110(?!\d)")
OWN: Final = -1


class JobLines:
    """The job's commands, and which of them comes next.

    Parameters
    ----------
    gcode : bytes
        The file.
    printer : Printer
        Whose firmware family says how a line is read.
    journal : Path, optional
        Of the host that prints it, which tells what is inserted; it may not be there yet.
    """

    def __init__(self, gcode: bytes, printer: Printer, journal: Path | None = None) -> None:
        self._own = [command for command in read_file(gcode, printer).lines if command]
        self._printer, self._journal = printer, journal
        self._begin()

    def _begin(self) -> None:
        self._commands, self._next = list(self._own), 0
        self._inserts, self._journal_bytes, self._flow = 0, 0, 1.0

    def find(self, line: bytes) -> int:
        """Command of the job, from 0, that a line is, with number and checksum or without.

        -1 for a host's own. A move by hand that happens to be the job's next one is taken for it.
        """
        number = self._find(line)
        return self._find(line) if number == OWN and self._has_grown() else number

    def _find(self, line: bytes) -> int:
        at = self._next
        match = _NUMBERED.match(line.rstrip())
        if match is None or at >= len(self._commands):
            return OWN
        wanted = self._commands[at]
        return at if match[1] == wanted or self._sent(match[1]) == wanted else OWN

    def take(self, line: bytes) -> int:
        """The same, for a line that is done now: the next command of the job follows it."""
        if _BEGINS.match(line):  # the lines are numbered anew: a print begins
            self._begin()
            return OWN
        number = self.find(line)
        if number != OWN:
            self._next = number + 1
        return number

    def _has_grown(self) -> bool:
        """Put new inserts of the journal into the commands; whether there was one."""
        if self._journal is None:
            return False
        try:
            size = self._journal.stat().st_size
        except OSError:
            return False
        if size == self._journal_bytes:
            return False
        self._journal_bytes = size
        new = inserted_lines(self._journal)[self._inserts :]
        for one in new:
            before, rest = self._commands[: one.after], self._commands[one.after :]
            if one.flow != self._flow:
                rest = with_flow(rest, plunger_count(before), one.flow / self._flow)
                self._flow = one.flow
            self._commands = [*before, *one.lines, *rest]
        self._inserts += len(new)
        return bool(new)

    def _sent(self, command: bytes) -> bytes:
        """As our link would send it; what can't be read is a host's own."""
        try:
            return read_line(command, self._printer).text
        except LineError:
            return b""


class Inserted(NamedTuple):
    """Commands before an insert, its lines, and the flow behind it.

    The format is `printctl.machine.records.journal`'s, once more, because a simulated printer
    imports nothing of its host: ``<crc32 of the JSON, 8 hex digits> <JSON>`` a line, records with
    ``t: insert``, ``after`` (commands of the job before, earlier inserts counted), ``lines`` and
    perhaps ``flow``: what writes behind it pushes so many times what the file says.
    """

    after: int
    lines: list[bytes]
    flow: float


def inserted_lines(journal: Path) -> list[Inserted]:
    """Return what was inserted, in order.

    Records of a print before the last one that began anew aren't distinguished: the host keeps one
    print in a journal. A line that is torn or damaged is passed over.
    """
    inserted: list[Inserted] = []
    try:
        text = journal.read_bytes()
    except OSError:
        return inserted
    for line in text.splitlines():
        crc, _, record = line.partition(b" ")
        if b'"insert"' not in record or crc != b"%08x" % zlib.crc32(record):
            continue
        entry = json.loads(record)
        if entry.get("t") == "insert":
            lines = [str(one).encode() for one in entry["lines"]]
            inserted.append(Inserted(int(entry["after"]), lines, float(entry.get("flow", 1.0))))
    return inserted
