"""Checks of what is mounted and filled: syringe, needle, bath."""

from __future__ import annotations

import math

from firmware_profiles import Bath, Needle, Syringe
from printctl.preflight.check import Check
from sim.dryrun import DryRun


def syringe_check(run: DryRun, syringe: Syringe) -> Check:
    """Ink pushed at the farthest point, with what stays in the needle, against the filling."""
    pushed = run.plunger_max_mm * math.pi / 4 * syringe.inner_mm**2
    return Check(
        f"ink, with {syringe.dead_volume_ul:g} µL dead volume",
        pushed + syringe.dead_volume_ul,
        syringe.volume_ul,
        "µL",
        pushed + syringe.dead_volume_ul <= syringe.volume_ul,
        syringe.name,
        "use a larger syringe or a smaller part",
    )


def needle_check(part_height_mm: float, needle: Needle) -> Check:
    """Whether the needle reaches the part's bottom before its hub dips into the bath."""
    return Check(
        "depth of the part against the needle's length",
        part_height_mm,
        needle.length_mm,
        "mm",
        part_height_mm <= needle.length_mm,
        needle.name,
        "use a longer needle or a flatter part",
    )


def bath_check(bath: Bath) -> list[Check]:
    """Whether the bath holds while printing and still melts out; none for a bath that stays."""
    if bath.melt_out_c is None:
        return []
    return [
        Check(
            "printing temperature of the bath, below its melt-out",
            bath.max_printing_c,
            bath.melt_out_c,
            "°C",
            bath.max_printing_c < bath.melt_out_c,
            bath.name,
            "mend the bath's profile",
        )
    ]


def crossings_check(crossings: int, allowed: int) -> Check:
    """How often the plan drives the needle's shaft through what is already written."""
    return Check(
        "passes of the needle's shaft through written ink",
        crossings,
        allowed,
        "",
        crossings <= allowed,
        "toolpath.allowed_crossings",
        "use a thinner needle or a sparser network, or allow them in the recipe and look at the "
        "report for where they are",
    )
