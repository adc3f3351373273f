"""Exception class of the report package, for input that can't be shown.

::

    RegistrationError
    └── ReportError             something that can't be shown
"""

from __future__ import annotations

from registration.errors import RegistrationError


class ReportError(RegistrationError):
    """Bad input to the report; the message says what, value, limit, unit and remedy."""
