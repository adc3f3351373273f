"""Parts of the simulator that belong to one firmware family, found by their files.

A family's folder may hold ``printer.py``, whose ``PRINTER`` plays its firmware, and ``reading.py``,
whose ``translate`` puts a file in another language into the words of G-code.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import TYPE_CHECKING

from firmware_profiles import Printer
from firmware_profiles.families import family_names
from sim.errors import ServeError
from sim.families.translated import Translated

if TYPE_CHECKING:
    from sim.marlin import MarlinPrinter

Translate = Callable[[bytes, Printer], Translated]


def simulated_printer(printer: Printer) -> type[MarlinPrinter]:
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
    module = _part(printer.firmware, "printer")
    if module is None:
        named = [name for name in family_names() if _part(name, "printer")]
        raise ServeError(
            f"firmware {printer.firmware!r} (profile: {printer.name}) has no simulated printer; "
            f"there are {', '.join(named)}"
        )
    found: type[MarlinPrinter] = module.PRINTER
    return found


def translator_of(printer: Printer) -> Translate | None:
    """What puts the printer's files into the words of G-code; None where they are in them."""
    module = _part(printer.firmware, "reading")
    if module is None:
        return None
    found: Translate = module.translate
    return found


@cache
def _part(family: str, name: str) -> ModuleType | None:
    package = f"{__package__}.{family}"
    if find_spec(package) is None or find_spec(f"{package}.{name}") is None:
        return None
    return import_module(f"{package}.{name}")
