"""Checks before the first byte is sent; one that fails refuses the print."""

from printctl.preflight.check import Check, refuse_failed
from printctl.preflight.gcode_checks import gcode_checks
from printctl.preflight.setup_checks import (
    bath_check,
    crossings_check,
    needle_check,
    syringe_check,
)

__all__ = [
    "Check",
    "bath_check",
    "crossings_check",
    "gcode_checks",
    "needle_check",
    "refuse_failed",
    "syringe_check",
]
