"""Choose and run the fit for a calibration pattern: lines, spiral, comb, joints or bridges."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from printctl.calibration.patterns import WrittenPattern
from printctl.calibration.widths.factors import GivenValues
from printctl.calibration.widths.lines import fit_lines
from printctl.calibration.widths.meetings import fit_bridge, fit_comb, fit_joint
from printctl.calibration.widths.result import Answer, Replies, Widths
from printctl.calibration.widths.spiral import fit_spiral

VAGUE: Final = 0.05
"""Half of a picture's relative 95 % interval of widths beyond which no factor is written."""
_BY_WIDTH: Final = ("bead", "flow_factor", "swell_factor")


def fit_widths(written: WrittenPattern, widths: Widths, known: GivenValues) -> Answer:
    """Fit lines, or a spiral.

    Raises
    ------
    UsageError
        With too few widths, or widths that no ink has.
    """
    fit = fit_spiral if written.pattern.name == "spiral" else fit_lines
    answer = fit(written, widths, known)
    return answer if widths.optics <= VAGUE else _kept_from_profiles(answer, widths.optics)


def _kept_from_profiles(answer: Answer, optics: float) -> Answer:
    """Without the factors, which rest on the absolute width; a lag rests on its changes."""
    changes = {key: one for key, one in answer.changes.items() if key not in _BY_WIDTH}
    note = (
        f"flow factor and swelling aren't written: the picture leaves all widths uncertain by "
        f"{optics:.0%} ({VAGUE:.0%} at most)"
    )
    return replace(answer, changes=changes, notes=[*answer.notes, note])


def fit_replies(written: WrittenPattern, replies: Replies) -> Answer:
    """Fit a comb, joints or bridges."""
    fit = {"comb": fit_comb, "joint": fit_joint}.get(written.pattern.name, fit_bridge)
    return fit(written, replies)
