"""Exception classes of G-code, deposit and needle clearance, and the base of the simulator's.

::

    SimError                    anything a user can mend on the simulator's side
    ├── GcodeError              G-code that can't be read at all
    │   └── LineError           one line of it: which sort of fault, and what to do
    ├── DepositError            motion that can't be turned into a deposit
    └── ClearanceError          a job whose shaft can't be checked with these settings

What is wrong with G-code that *can* be read comes as data (`gcode.dry_run.run.Finding`),
because the caller decides which finding refuses a print.
"""

from __future__ import annotations


class SimError(ValueError):
    """Bad input to the simulator; the message says what, value, limit, unit and remedy."""


class GcodeError(SimError):
    """G-code that can't be read."""


class LineError(GcodeError):
    """A line that can't be read, or that firmwares read differently.

    Parameters
    ----------
    sort : str
        One of `gcode.reading.line.SORTS`.
    line : str
        The line, as far as it can be shown.
    reason : str
        What is wrong, and the remedy.
    """

    def __init__(self, sort: str, line: str, reason: str) -> None:
        super().__init__(f"{line!r}: {reason}")
        self.sort = sort
        self.line = line
        self.reason = reason


class DepositError(SimError):
    """Motion that can't be turned into a deposit."""


class ClearanceError(SimError):
    """A job whose needle's shaft can't be checked against what is written."""
