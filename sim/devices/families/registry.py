"""Find the simulated printer class of the firmware that a printer's profile names.

A family may have ``NAME_printer.py``, whose ``PRINTER`` plays its firmware.
"""

from __future__ import annotations

from firmware_profiles import Printer
from firmware_profiles.families import family_names
from gcode.reading.line import family_part
from sim.devices.board.printer import SimulatedPrinter
from sim.errors import ServeError


def simulated_printer(printer: Printer) -> type[SimulatedPrinter]:
    """The class that plays the firmware which a profile names.

    Raises
    ------
    ServeError
        When there is none.
    """
    if not printer.streamed:
        raise ServeError(
            f"{printer.name} takes no lines from a host, so there is no simulated one to send them "
            "to; `printctl simulate FILE` runs its file through the dry run"
        )
    module = family_part(printer.firmware, "printer")
    if module is None:
        named = [name for name in family_names() if family_part(name, "printer")]
        raise ServeError(
            f"firmware {printer.firmware!r} (profile: {printer.name}) has no simulated printer; "
            f"there are {', '.join(named)}"
        )
    printer_class: type[SimulatedPrinter] = module.PRINTER
    return printer_class
