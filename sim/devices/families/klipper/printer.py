"""Simulated printer with Klipper firmware, modelled in `sim.devices.families.klipper.firmware`."""

from __future__ import annotations

from typing import Final

from sim.devices.board.printer import SimulatedPrinter
from sim.devices.families.klipper.firmware import Klipper


class KlipperPrinter(SimulatedPrinter):
    """A board with Klipper; see the module."""

    def make_firmware(self) -> Klipper:
        """Return its firmware part."""
        return Klipper(self)


PRINTER: Final = KlipperPrinter
