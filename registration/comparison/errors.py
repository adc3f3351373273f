"""Exceptions: registrations that can't be compared, or aren't a crossed gauge (R&R) study.

::

    RegistrationError
    └── ComparisonError         registrations that can't be held against each other
        └── GaugeStudyError     registrations that don't make a gauge study
"""

from __future__ import annotations

from registration.errors import RegistrationError


class ComparisonError(RegistrationError):
    """Registrations that can't be compared; the message says which, why and what to do."""


class GaugeStudyError(ComparisonError):
    """Operators, parts and repeats that don't make a crossed study."""
