"""The seam between moves and a firmware's language."""

from __future__ import annotations

from typing import Final, Protocol

from design.errors import ToolpathError
from design.toolpath.gcode.marlin import Marlin
from firmware_profiles import Printer


class Dialect(Protocol):
    """What differs between firmwares; moves (G0, G1), G4 and G92 are common to all."""

    def header(self, printer: Printer) -> list[str]:
        """Lines before the first move: units, absolute positions and absolute E."""

    def footer(self) -> list[str]:
        """Lines after the last move."""


DIALECTS: Final[dict[str, Dialect]] = {"marlin": Marlin()}


def dialect_of(printer: Printer) -> Dialect:
    """Dialect of the printer's firmware.

    Raises
    ------
    ToolpathError
        When there is none yet.
    """
    if printer.firmware not in DIALECTS:
        raise ToolpathError(
            f"no G-code writer for firmware {printer.firmware!r} (profile {printer.name!r}); "
            f"there is one for: {', '.join(sorted(DIALECTS))}"
        )
    return DIALECTS[printer.firmware]
