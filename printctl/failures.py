"""Map exceptions to exit codes and messages of the command line.

Exit codes: 0 done, 1 failed, 2 wrong use, 3 a safety check refused, 4 the printer failed.
"""

from __future__ import annotations

import sys
from contextvars import ContextVar
from typing import Any, Final

from printctl.errors import PrintctlError, SafetyError
from printctl.system_errors import explain

CODES: tuple[tuple[str, str, int], ...] = (
    ("printctl.machine.errors", "NoLink", 1),  # not the printer's fault, as the next three
    ("printctl.machine.errors", "JournalError", 1),
    ("printctl.machine.errors", "HistoryError", 1),
    ("printctl.machine.errors", "Refused", 1),
    ("printctl.machine.errors", "JobError", 3),
    ("printctl.machine.errors", "LinkError", 4),
    ("firmware_profiles", "ProfileError", 2),
    ("design.errors", "FlowInputError", 2),
    ("design.errors", "DesignError", 1),
    ("registration.measuring.judging.tolerance", "ToleranceError", 2),
    ("registration.errors", "RegistrationError", 1),
    ("gcode.errors", "GcodeError", 2),
    ("gcode.errors", "SimError", 1),
)
"""Module, error and exit code; the first that fits counts."""

JSON_PRINTED: Final = ContextVar("JSON_PRINTED", default=False)
"""Whether the command has printed its one object on stdout already."""


def error_facts(exc: BaseException | None, message: str, code: int) -> dict[str, Any]:
    """Return a failure JSON-ready, as it stands beside or in place of a command's result."""
    facts = {"kind": type(exc).__name__.lstrip("_"), "code": code, "message": message}
    kinds = exc.kinds if isinstance(exc, SafetyError) else ()
    return {"error": facts | ({"checks": list(kinds)} if kinds else {})}


def message_and_code(exc: Exception) -> tuple[str, int] | None:
    """Return a failure's message and exit code, or None for an internal error."""
    if isinstance(exc, PrintctlError):
        return str(exc), exc.exit_code
    for module, name, code in CODES:
        # What no module that is loaded defines can't have been raised.
        if module in sys.modules and isinstance(exc, getattr(sys.modules[module], name)):
            return str(exc), code
    if isinstance(exc, NotADirectoryError | FileExistsError):
        return f"{exc.filename} is a file, or lies in one; give a folder's name", 2
    if isinstance(exc, IsADirectoryError):
        return f"{exc.filename} is a folder; give a file's name", 2
    return (explain(exc).message, 1) if isinstance(exc, OSError | MemoryError) else None
