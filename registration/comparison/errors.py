"""Errors of the comparison.

::

    RegistrationError
    └── ComparisonError         registrations that can't be held against each other
"""

from __future__ import annotations

from registration.errors import RegistrationError


class ComparisonError(RegistrationError):
    """Registrations that can't be compared; the message says which, why and what to do."""
