"""The fit of each sort of pattern."""

from __future__ import annotations

from printctl.calibration.patterns import Written
from printctl.calibration.widths.answer import Answer, Replies, Widths
from printctl.calibration.widths.factors import Known
from printctl.calibration.widths.lines import fit_lines
from printctl.calibration.widths.meetings import fit_bridge, fit_comb, fit_joint
from printctl.calibration.widths.spiral import fit_spiral


def fit_widths(written: Written, widths: Widths, known: Known) -> Answer:
    """Fit lines, or a spiral.

    Raises
    ------
    UsageError
        With too few widths, or widths that no ink has.
    """
    fit = fit_spiral if written.pattern.name == "spiral" else fit_lines
    return fit(written, widths, known)


def fit_replies(written: Written, replies: Replies) -> Answer:
    """Fit a comb, joints or bridges."""
    fit = {"comb": fit_comb, "joint": fit_joint}.get(written.pattern.name, fit_bridge)
    return fit(written, replies)
