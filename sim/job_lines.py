"""Which command of a job's file a line is that a host sends, by what stands in it.

A host puts in lines of its own (a checkpoint's question, a pause's lift), which have numbers too,
so that a line's number alone doesn't tell the file's command. The text does: a host sends the
file's commands in the file's order, and a line that isn't the next of them is the host's own.
"""

from __future__ import annotations

import re
from typing import Final

_NUMBERED: Final = re.compile(rb"(?:N\d+ *)?(.*?) *(?:\*\d*)?$", re.DOTALL)
_CODE: Final = re.compile(rb"^([GMT])0+(?=\d)")
_PARENTHESES: Final = re.compile(rb"\([^)]*\)")
_BEGINS: Final = re.compile(rb"(?:N-?\d+ *)?M0*110(?!\d)")
OWN: Final = -1


class JobLines:
    """The file's commands, and which of them comes next.

    Parameters
    ----------
    gcode : bytes
        The file.
    """

    def __init__(self, gcode: bytes) -> None:
        plain = (_PARENTHESES.sub(b"", raw.split(b";", 1)[0]).strip() for raw in gcode.splitlines())
        self._commands = [_code(command) for command in plain if command]
        self._next = 0

    def find(self, line: bytes) -> int:
        """Command of the file, from 0, that a line is, with number and checksum or without.

        -1 for a host's own. A move by hand that happens to be the file's next one is taken for it.
        """
        at = self._next
        found = _NUMBERED.match(line.rstrip())
        same = at < len(self._commands) and found and _code(found[1]) == self._commands[at]
        return at if same else OWN

    def take(self, line: bytes) -> int:
        """The same, for a line that is done now: the next command of the file follows it."""
        if _BEGINS.match(line):  # the lines are numbered anew: a print begins
            self._next = 0
            return OWN
        found = self.find(line)
        if found != OWN:
            self._next = found + 1
        return found


def _code(command: bytes) -> bytes:
    """With the command's number written without zeros before it: M0400 is M400."""
    return _CODE.sub(rb"\1", command)
