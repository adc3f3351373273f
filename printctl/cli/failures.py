"""How failures leave the command line.

Exit codes: 0 done, 1 failed, 2 wrong use, 3 a safety check refused, 4 the printer failed.
"""

from __future__ import annotations

import errno
import sys

from printctl.errors import PrintctlError

CODES: tuple[tuple[str, str, int], ...] = (
    ("printctl.link.errors", "NoLink", 1),  # not the printer's fault, as the next three
    ("printctl.link.errors", "JournalError", 1),
    ("printctl.link.errors", "HistoryError", 1),
    ("printctl.link.errors", "Refused", 1),
    ("printctl.link.errors", "LinkError", 4),
    ("firmware_profiles", "ProfileError", 2),
    ("design.errors", "DesignError", 1),
    ("registration.errors", "RegistrationError", 1),
    ("sim.errors", "SimError", 1),
)
"""Module, error and exit code; the first that fits counts."""


def message_and_code(exc: Exception) -> tuple[str, int] | None:
    """What to say and the exit code, or None for what is a fault of ours."""
    if isinstance(exc, PrintctlError):
        return str(exc), exc.exit_code
    for module, name, code in CODES:
        # What no module that is loaded defines can't have been raised.
        if module in sys.modules and isinstance(exc, getattr(sys.modules[module], name)):
            return str(exc), code
    return (disk_message(exc), 1) if isinstance(exc, OSError) else None


def disk_message(exc: OSError) -> str:
    """Name the file and the remedy of a failed read or write."""
    place = f" ({exc.filename})" if exc.filename else ""
    if exc.errno == errno.ENOSPC:
        return (
            f"the disk is full{place}; free some space and run the same command again: files that "
            "were there before are untouched"
        )
    return f"{exc.strerror or exc}{place}"
