"""Choose the G-code dialect of a printer's firmware."""

from __future__ import annotations

from design.errors import ToolpathError
from firmware_profiles import Printer, ProfileError
from firmware_profiles.families import family_of
from firmware_profiles.families.dialect import Dialect


def dialect_of(printer: Printer) -> Dialect:
    """Return the dialect of the printer's firmware.

    Raises
    ------
    ToolpathError
        When there is none, or the profile doesn't say enough to choose it.
    """
    try:
        return family_of(printer).dialect(printer)
    except ProfileError as exc:
        raise ToolpathError(f"no G-code can be written: {exc}") from exc
