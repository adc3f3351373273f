"""Check needle length, ink and bath chemistry, and filament support, without G-code."""

from __future__ import annotations

import math
from typing import Final

from firmware_profiles import Bath, Ink, Needle, supported_diameter_mm
from printctl.checks.preflight.profile_checks import profile_checks
from printctl.checks.set_up.check import Check

_WORDS: Final = {
    "neutral_ph": "a buffer of neutral pH",
    "calcium": "calcium",
    "thrombin": "thrombin",
}


def needle_check(part_height_mm: float, needle: Needle) -> Check:
    """Whether the needle reaches the part's bottom before its hub dips into the bath."""
    return Check(
        "depth of the part against the needle's length",
        part_height_mm,
        needle.length_mm,
        "mm",
        part_height_mm <= needle.length_mm,
        "needle: length_mm",
        f"the hub of {needle.name} would dip in; use a longer needle or a flatter part",
    )


def chemistry_check(ink: Ink, bath: Bath) -> Check:
    """Whether the bath has what sets the ink; without it the print runs away."""
    missing = [trigger for trigger in ink.gelled_by if trigger not in bath.provides]
    needs = " and ".join(_WORDS[trigger] for trigger in missing)
    return Check(
        "what sets the ink and the bath lacks",
        len(missing),
        0,
        "",
        not missing,
        "bath: provides",
        f"{ink.name} sets by {needs}, which {bath.name} doesn't have (gelled_by, provides); take "
        "another bath, or say in its profile that it is in it",
    )


def bath_checks(bath: Bath) -> list[Check]:
    """Whether the bath holds while printing and still melts out; whether its profile is whole."""
    others = [check for check in profile_checks(bath) if check.place != "max_printing_c"]
    if bath.melt_out_c is None:
        return others
    return [
        Check(
            "printing temperature of the bath, below its melt-out",
            bath.max_printing_c,
            bath.melt_out_c,
            "°C",
            bath.max_printing_c < bath.melt_out_c,
            "bath: max_printing_c",
            f"mend the profile of {bath.name}: it would melt while it is printed in",
        ),
        *others,
    ]


def held_check(widest_mm: float, ink: Ink, bath: Bath) -> Check:
    """The thickest filament written, against what the bath's yield stress holds up."""
    held = supported_diameter_mm(bath, ink)
    # Where densities are equal nothing sinks; a limit must be a number all the same.
    limit = held if math.isfinite(held) else widest_mm
    return Check(
        "thickest filament in the bath",
        widest_mm,
        limit,
        "mm",
        widest_mm <= limit,
        "bath: yield_stress_pa, density_g_cm3",
        f"{ink.name} would sink or float in {bath.name}; write it thinner, or take a bath with "
        "more yield stress or nearer in density",
        "refuses" if bath.calibrated and ink.calibrated else "warns",
    )
