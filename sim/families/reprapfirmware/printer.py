"""Simulated Duet with RepRapFirmware, modelled in `sim.families.reprapfirmware.firmware`."""

from __future__ import annotations

from typing import Final

from sim.board.printer import SimulatedPrinter
from sim.families.reprapfirmware.firmware import RepRapFirmware


class DuetPrinter(SimulatedPrinter):
    """A board with RepRapFirmware; see the module."""

    def make_firmware(self) -> RepRapFirmware:
        """Return its firmware part."""
        return RepRapFirmware(self)


PRINTER: Final = DuetPrinter
