"""Simulated Duet with RepRapFirmware, modelled in `reprapfirmware.firmware`."""

from __future__ import annotations

from typing import Final

from sim.devices.board.printer import SimulatedPrinter
from sim.devices.families.reprapfirmware.firmware import RepRapFirmware


class DuetPrinter(SimulatedPrinter):
    """A board with RepRapFirmware; see the module."""

    def make_firmware(self) -> RepRapFirmware:
        """Return its firmware part."""
        return RepRapFirmware(self)


PRINTER: Final = DuetPrinter
