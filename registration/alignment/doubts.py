"""Put the reasons for doubting a scan's pose into sentences."""

from __future__ import annotations

from collections.abc import Iterable

from registration.alignment.freedoms import UNKNOWN_MM, LooseFreedom
from registration.alignment.misfits import OFF_MM, Misfit
from registration.alignment.rivals import AlternativePose


def pose_doubts(
    rivals: Iterable[AlternativePose],
    loose: Iterable[LooseFreedom],
    off: Iterable[Misfit],
    limit: float,
) -> tuple[str, ...]:
    """Return a sentence for each reason to doubt a pose; `limit` is of the rivals' lead."""
    out = [
        rival_words(rival, limit)
        for rival in rivals
        if rival.lead < limit and not (rival.mirrored and rival.same)
    ]
    out += [
        f"The scan doesn't fix {one.words}: known to ± {one.half_mm:.2f} mm (95 %, limit "
        f"{UNKNOWN_MM:g} mm); scan more of the part."
        for one in loose
    ]
    out += [
        f"After the fit the {one.words} are off the design by {1e3 * one.off_mm:+.0f} µm (limit "
        f"{1e3 * OFF_MM:.0f} µm), so the pose isn't known better than that; check the refractive "
        "index and how deep light reaches, or the print."
        for one in off
    ]
    return tuple(out)


CROSS_UM = 20.0
"""Two programs differ by less about where the corners of a well-seen part lie: by 1 to 11 µm in 25
scans of four generators whose walls were told rightly, by 29 and more in 13 others, nearly all with
false walls."""
LEAST_SEEN = 0.5
"""Share of the scanned surface that light must reach: levels are told from there alone."""


def later_doubts(cross_um: float | None, seen: float) -> tuple[str, ...]:
    """Return a sentence for each reason that is known only after the fit.

    Parameters
    ----------
    cross_um : float or None, µm
        Between our pose and another program's.
    seen : float
        Share of the scanned surface that lies where light reaches.
    """
    out = []
    if cross_um is not None and cross_um > CROSS_UM:
        out.append(
            f"Another program (small_gicp), asked for the same pose, carries a corner of the part "
            f"{cross_um:.0f} µm from ours (limit {CROSS_UM:g} µm): one of the two is wrong; look "
            "at the contours in the raw scan, and scan with more light or contrast."
        )
    if seen < LEAST_SEEN:
        out.append(
            f"Light reached {100 * seen:.0f} % of the scanned surface (limit "
            f"{100 * LEAST_SEEN:.0f} %), too little to tell gel from liquid by; scan with more "
            "light or contrast."
        )
    return tuple(out)


def rival_words(rival: AlternativePose, limit: float) -> str:
    """Say where else the part may lie and what would tell."""
    if rival.same:
        return (
            f"The design is the same after {rival.motion}: no scan tells which way it lies; give "
            "the design a mark, such as a dimple in one corner."
        )
    x, y, z = rival.place_mm
    where = f"most (by {rival.apart_um:.0f} µm) at x {x:.2f}, y {y:.2f}, z {z:.2f} mm"
    return (
        f"The part may lie otherwise, {_by(rival.motion)}: that pose deviates only "
        f"{rival.lead:.2f} times as much where the two differ (limit {limit:g}). They differ "
        f"{where}, {_remedy(rival)}."
    )


def _by(motion: str) -> str:
    """Put "by" before each part of a motion that takes it: turns and shifts, no mirroring."""
    parts = motion.split(" and ")
    return " and ".join(part if part.startswith("mirrored") else f"by {part}" for part in parts)


def _remedy(rival: AlternativePose) -> str:
    if rival.seen:
        return "which was seen but doesn't decide; scan it more sharply"
    if rival.amid:
        return (
            "where the design has a surface and the scan found none, though it did around it: the "
            "print lacks it, or light failed there"
        )
    return "which wasn't seen; scan it too"
