"""Track axes of a simulated board with a known position (homed, set); detect moves of others."""

from __future__ import annotations

from typing import Final

from sim.gcode.program.gcode import Command

_ALL: Final = frozenset("XYZ")


class PlacedAxes:
    """Axes that were homed, or told where they are, since power came or the motors lost it."""

    def __init__(self) -> None:
        self._placed: set[str] = set()

    def forget(self) -> None:
        """Motors have lost their power."""
        self._placed.clear()

    def place(self, command: Command) -> None:
        """Note the axes that a command gives a number."""
        self._placed |= command.values.keys() & _ALL

    def home(self, command: Command) -> None:
        """Note the axes that a command names; all where it names none."""
        self._placed |= (command.flags | command.values.keys()) & _ALL or _ALL

    def place_all(self) -> None:
        """Note all."""
        self._placed |= _ALL

    def refuse(self, command: Command) -> bool:
        """Whether a command moves an axis that has no place."""
        moves = command.letter == "G" and command.number <= 3
        return moves and not command.values.keys() & _ALL <= self._placed
