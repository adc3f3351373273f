"""Exception class for a print for which no mend can be planned.

::

    PrintctlError
    └── MendError   no mend can be planned for this print at all
"""

from __future__ import annotations

from printctl.errors import PrintctlError


class MendError(PrintctlError):
    """No mend can be planned; the message says why, and what to do."""
