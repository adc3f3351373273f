"""Count job lines whose motion has certainly been executed.

A firmware says ok when it has put a move into its planner. So the last moves taken, as many as
planner and command queue hold, may still be ahead; once it has answered M400, none is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from firmware_profiles import Printer
from printctl.machine.families import link_facts
from sim.gcode.reading import is_motion


def surely_moved(lines: Sequence[bytes], taken: int, queued: float, least: int = 0) -> int:
    """Lines whose motion had ended when ``taken`` were taken.

    Parameters
    ----------
    lines : sequence of bytes
        The job's.
    taken : int
    queued : float
        Most moves that may be ahead; infinite where nobody knows.
    least : int
        So many are known to have been made.
    """
    if math.isinf(queued):
        return min(least, taken)
    left = queued
    for index in range(taken - 1, least - 1, -1):
        if is_motion(lines[index]):
            if left == 0:
                return index + 1
            left -= 1
    return min(least, taken)


def moves_ahead(printer: Printer) -> float:
    """Most moves that a printer may have taken and not made.

    Infinite for a firmware that plans by time: short moves are ahead by the hundred.
    """
    if link_facts(printer).plans_by_time:
        return math.inf
    return printer.planner_blocks + printer.command_queue


class CompletedMoves:
    """Counts them as a job goes on; never more than is true.

    Parameters
    ----------
    lines : sequence of bytes
        The job's.
    printer : Printer
    """

    def __init__(self, lines: Sequence[bytes], printer: Printer) -> None:
        self._lines, self._ahead = lines, moves_ahead(printer)
        self._sure = self._compared = 0
        self._dropped = False

    def waited(self, taken: int) -> None:
        """Take notice that the printer stands still after ``taken`` lines."""
        if not self._dropped:
            self._sure = taken

    def drop(self) -> None:
        """Take notice that the moves which were ahead won't be made: no more lines will be."""
        self._dropped = True

    def doubt(self) -> None:
        """Take notice that moves which were acknowledged weren't made: nobody knows how many.

        Made are those before the last place that was compared and found right.
        """
        self._ahead, self._sure, self._dropped = math.inf, self._compared, True

    def compare(self, taken: int) -> None:
        """Take notice that the printer stands where ``taken`` lines lead."""
        self._compared = taken

    def stood(self, line: int) -> None:
        """Take notice that the printer stood in the line after so many: those were made."""
        self._sure = max(self._sure, line)

    def back(self, taken: int) -> None:
        """Take notice that lines after these weren't taken after all."""
        self._sure = min(self._sure, taken)
        self._compared = min(self._compared, taken)

    def grow(self, lines: Sequence[bytes]) -> None:
        """Take a job that has got lines behind those that were taken."""
        self._lines = lines

    def after(self, taken: int) -> int:
        """Lines made when ``taken`` were taken; any thread may ask."""
        made = surely_moved(self._lines, taken, self._ahead, self._sure)
        self._sure = max(self._sure, made)
        return made
