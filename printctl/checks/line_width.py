"""Check the width of a line against the needle's bore: a line much narrower isn't laid.

A tip that moves faster than the ink leaves the bore draws the line thinner than the bore; beyond a
stretch that each ink has of its own the line breaks (Yuk & Zhao, Adv. Mater. 30, 1704028, 2018,
doi:10.1002/adma.201704028). How far nobody has measured for these inks: `THINNEST_BORE`.
"""

from __future__ import annotations

from firmware_profiles import Needle, load, shipped
from firmware_profiles.tools import THINNEST_BORE
from printctl.checks.kinds import Kind
from printctl.checks.set_up import Check


def shipped_bores() -> dict[str, float]:
    """Return the bore of each shipped needle, mm, by name."""
    return {name: load(Needle, name).inner_mm for name in shipped(Needle)}


def bore_check(
    width_mm: float, needle: Needle, thinnest: float = THINNEST_BORE, place: str = "line_um"
) -> Check:
    """Check the width of a line against the needle's bore.

    Parameters
    ----------
    width_mm : float, mm
        Of a line as it lies there.
    needle : Needle
    thinnest : float
        Narrowest line, as a part of the bore.
    place : str
        Where the width comes from.
    """
    limit, remedy = thinnest * needle.inner_mm, ""
    passed = width_mm >= limit * (1 - 1e-9)
    if not passed:
        fine = {name: bore for name, bore in shipped_bores().items() if thinnest * bore <= width_mm}
        name = max(fine, key=lambda one: fine[one], default="")
        remedy = (
            f"{needle.name} has a bore of {needle.inner_mm:g} mm; beads thinner than {thinnest:g} "
            f"of it break; use a needle with a bore up to {width_mm / thinnest:.3g} "
            f"mm{f' ({name}: {fine[name]:g} mm)' if name else ''}, print beads of at least "
            f"{limit:.3g} mm, or, if tested with this ink, allow thinner ones (thinnest_bore, "
            "--thinnest-bore)"
        )
    return Check(
        Kind.BEAD_WIDTH,
        "bead width vs. needle bore",
        width_mm,
        limit,
        "mm",
        passed,
        f"{place}, needle: inner_mm",
        remedy,
    )
