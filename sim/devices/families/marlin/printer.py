"""Simulated printer class: the generic board with Marlin 2.1 firmware.

Modelled, after the transcripts recorded from a real Marlin (`tests/sim/data/marlin`), besides what
any board has (`sim.devices.board.printer`):

- line numbers and checksums: errors, ``Resend`` with its trailing ``ok`` and the flush in
  mid-line, repeated lines dropped without an answer;
- busy messages, reports of temperature and position, dwells, waits for heat and for the user,
  cold extrusion, M85, M112, M410, M108 with and without emergency parser, ADVANCED_OK, stored
  settings, reset, and kill: silence until a reset, and motors that run on for a while
  (`sim.devices.families.marlin.halt`).

Not modelled: tuning of the heaters (M303), the EEPROM's image (stored settings outlast a reset,
their CRC is always the same).
"""

from __future__ import annotations

from typing import Final

from sim.devices.board.printer import SimulatedPrinter
from sim.devices.families.marlin.firmware import Marlin


class MarlinPrinter(SimulatedPrinter):
    """A board with Marlin; see the module."""

    def make_firmware(self) -> Marlin:
        """Return its firmware part."""
        return Marlin(self)


PRINTER: Final = MarlinPrinter
