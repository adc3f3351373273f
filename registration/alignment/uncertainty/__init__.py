"""Uncertainty of scan measurements by the GUM: terms, budgets, 95 % intervals.

Goes in: standard uncertainties of scan and fit. Comes out: budgets and intervals. Begin with
`budget.py`.
"""

from registration.alignment.uncertainty.budget import (
    Budget,
    Term,
    at_either_end,
    coverage_factor,
    rectangular,
)
from registration.alignment.uncertainty.flow import pressure_interval
from registration.alignment.uncertainty.scan_errors import (
    BLUR_PART,
    LEAST_STEP,
    MOST_UNEVEN,
    ROOT_TWO_PI,
    ScanErrors,
    scan_errors,
)
from registration.alignment.uncertainty.sections import SectionErrors, section_errors
from registration.alignment.uncertainty.table import quantity, terms

__all__ = [
    "BLUR_PART",
    "LEAST_STEP",
    "MOST_UNEVEN",
    "ROOT_TWO_PI",
    "Budget",
    "ScanErrors",
    "SectionErrors",
    "Term",
    "at_either_end",
    "coverage_factor",
    "pressure_interval",
    "quantity",
    "rectangular",
    "scan_errors",
    "section_errors",
    "terms",
]
