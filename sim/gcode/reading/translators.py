"""Find the translator to G-code of a firmware family whose files are in another language.

A family's folder may hold ``reading.py``, whose ``translate`` puts a file in another language into
the words of G-code.
"""

from __future__ import annotations

from collections.abc import Callable

from firmware_profiles import Printer
from sim.family_parts import family_part
from sim.gcode.reading.translated import TranslatedProgram

Translate = Callable[[bytes, Printer], TranslatedProgram]


def translator_of(printer: Printer) -> Translate | None:
    """Return the translator of a printer's files to G-code; None if they are G-code."""
    module = family_part(printer.firmware, "reading")
    if module is None:
        return None
    translate: Translate = module.translate
    return translate
