"""The printer that plays Marlin."""

from typing import Final

from sim.marlin import MarlinPrinter

PRINTER: Final = MarlinPrinter
