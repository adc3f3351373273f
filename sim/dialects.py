"""The simulated printer of each firmware family."""

from __future__ import annotations

from typing import Final

from firmware_profiles import Printer
from sim.dialect_duet import DuetPrinter
from sim.dialect_klipper import KlipperPrinter
from sim.errors import ServeError
from sim.marlin import MarlinPrinter

_PRINTERS: Final[dict[str, type[MarlinPrinter]]] = {
    "marlin": MarlinPrinter,
    "reprapfirmware": DuetPrinter,
    "klipper": KlipperPrinter,
}


def simulated_printer(printer: Printer) -> type[MarlinPrinter]:
    """The class that plays the firmware which a profile names.

    Raises
    ------
    ServeError
        When there is none.
    """
    found = _PRINTERS.get(printer.firmware)
    if not printer.streamed:
        raise ServeError(
            f"{printer.name} takes no lines from a host, so there is no simulated one to send them "
            "to; `printctl simulate FILE` runs its file through the dry run"
        )
    if found is None:
        raise ServeError(
            f"firmware {printer.firmware!r} (profile: {printer.name}) has no simulated printer; "
            f"there are {', '.join(_PRINTERS)}"
        )
    return found
