"""Premises of a verdict: size, resolution, contrast, and whether the scan shows this part."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.alignment import LEAST_SEEN
from registration.json_ready import Record
from registration.measuring.judging import Decision, reason, worst_decision

Finding = tuple[Decision, str]

SHRUNK: Final = 0.03
"""Fitted scale off by more than prints usually shrink or swell."""
WRONG: Final = 0.15
"""No print shrinks or swells by so much: the scan's voxels are wrong, or it shows another part."""
FLAT: Final = 2.0
"""Of the widest lumen: along an axis that is no longer, the scale is that of diameters."""
WELL_LIT: Final = 0.9
"""Of the designed lumens' volume; where light shows less, vessels that it leaves open say so."""
MOST_UNTOLD: Final = 0.1
"""Of the vessels' sections whose liquid looks like gel; more is named as the scan's contrast."""


def mismatch(registration: Record) -> Finding | None:
    """Say why nothing else in the registration means anything; None where it does."""
    other = (registration.get("agreement") or {}).get("other_part")
    if (coarse := _too_coarse(registration)) and (other or _off_axes(registration, WRONG)):
        return coarse[0]
    if other:
        return "fail", _other_part(registration)
    if not _off_axes(registration, WRONG):
        return None
    lit = (registration.get("agreement") or {}).get("surface_lit")
    if lit is not None and lit < LEAST_SEEN:
        return "undecided", (
            f"Gel can't be told from liquid: light reached {100 * lit:.0f} % of the scanned "
            f"surface (limit {100 * LEAST_SEEN:.0f} %), so neither the part's size nor its lumens "
            "are known; scan with more light or contrast, or fill the lumens with a clearer liquid"
        )
    return "undecided", (
        f"Wrong voxel size, or the scan of another part: {scale_words(registration)} (limit "
        f"±{100 * WRONG:.0f} %). Check the voxel size{_voxel(registration)} and which part was "
        "scanned; nothing else was evaluated"
    )


def premises(registration: Record) -> list[Finding]:
    """Say what to know before the features: fitted scale (always), voxels, contrast."""
    scale, off = scale_words(registration), _off_axes(registration, SHRUNK)
    found: list[Finding] = []
    if off:
        found.append(
            (
                _of_size(registration),
                f"Shrinkage or swelling, or a wrong voxel size: {scale} (expected within "
                f"±{100 * SHRUNK:.0f} %); check the voxel size{_voxel(registration)}",
            )
        )
    elif scale:
        found.append(("pass", f"{scale[:1].upper()}{scale[1:]}"))
    features = registration["judging"]["features"]
    found += [("pass", reason(f)) for f in features if f.get("doubt") == "index"]
    return [*found, *_too_coarse(registration), *_dim(registration)]


def _of_size(registration: Record) -> Decision:
    """Return the decision on the sizes, whose limits may allow for more."""
    features = registration["judging"]["features"]
    sizes = [f["decision"] for f in features if f["name"] == "size"]
    return worst_decision(sizes) if sizes else "undecided"


def scale_words(registration: Record) -> str:
    """Say the fitted scale of each axis with its interval; empty where there is none."""
    scale = registration.get("scale")
    if not scale:
        return ""
    halves = (registration.get("interval_95") or {}).get("scale") or [None] * 3
    each = [_of_axis(*one) for one in zip("xyz", scale, halves, strict=True)]
    return f"fitted size, of the design's: {', '.join(each)}"


def _of_axis(axis: str, scale: float, half: float | None) -> str:
    if half is not None:
        return f"{axis} {100 * scale:.1f} ± {100 * half:.1f} %"
    return f"{axis} not fitted" if scale == 1 else f"{axis} {100 * scale:.1f} %, interval not known"


def _off_axes(registration: Record, limit: float) -> bool:
    """Whether any axis that is long enough to tell is off by more than a limit."""
    scale, size = registration.get("scale"), registration.get("size_mm")
    if not scale or not size:
        return False
    off = np.abs(np.array(scale, dtype=np.float64) - 1)
    return bool((_long(registration, np.array(size)) & (off > limit)).any())


def _long(registration: Record, size_mm: FloatArray) -> NDArray[np.bool_]:
    widest = max((row["designed_um"] or 0.0 for row in registration["vessels"]), default=0.0)
    return np.asarray(size_mm >= 1e-3 * FLAT * widest)


def _voxel(registration: Record) -> str:
    voxel = (registration.get("measured_by") or {}).get("voxel_um")
    if not voxel:
        return " (--voxel-um)"
    return f" ({' × '.join(f'{v:.3g}' for v in voxel)} µm; --voxel-um, or scan.voxel_um)"


def _other_part(registration: Record) -> str:
    """Say that the scan is of another part, with the evidence in numbers."""
    numbers = registration["agreement"]
    return (
        "The scan doesn't match the design: in the best pose "
        f"{100 * numbers['foreign_share']:.0f} % of the hollow space in the part lies where the "
        f"design has gel, {100 * numbers['designed_open']:.0f} % of the designed lumens' volume is "
        f"hollow, {100 * numbers['close_share']:.0f} % of the scanned surface lies within 0.25 mm "
        f"of the design; {scale_words(registration)}. Check which part was scanned, and which "
        "model was given; nothing else was evaluated"
    )


def _too_coarse(registration: Record) -> list[Finding]:
    needed = registration.get("needed_voxel_um")
    if not needed:
        return []
    voxel = (registration.get("measured_by") or {}).get("voxel_um")
    has = f" (this scan: {' × '.join(f'{v:.3g}' for v in voxel)} µm)" if voxel else ""
    thinnest = min(row["designed_um"] for row in registration["vessels"])
    return [
        (
            "undecided",
            f"The scan is too coarse: vessels of {thinnest:.0f} µm need voxels of at most "
            f"{needed:.0f} µm{has}; none of them can be called closed",
        )
    ]


def _dim(registration: Record) -> list[Finding]:
    """Say how much of the lumens the scan can't tell from gel, where a vessel is unknown by it."""
    if all(row["open"] is not None for row in registration["vessels"]):
        return []
    lit = (registration.get("agreement") or {}).get("lit_share")
    contrast = registration.get("contrast") or {}
    oct_scan = (registration.get("measured_by") or {}).get("modality") == "oct"
    remedy = (
        "scan from the side where they lie nearest to the surface, or by micro-CT"
        if oct_scan
        else "scan longer, or with a contrast agent"
    )
    if lit is not None and lit < WELL_LIT:
        why = "too little light comes back from there" if oct_scan else "the noise is too high"
        return [
            (
                "undecided",
                f"Gel can't be told from liquid in {100 * (1 - lit):.0f} % of the designed "
                f"lumens' volume: {why}; {remedy}",
            )
        ]
    untold = contrast.get("untold") or 0.0
    if untold <= MOST_UNTOLD:
        return []
    return [
        (
            "undecided",
            f"Gel can't be told from liquid in {100 * untold:.0f} % of the vessels' sections: the "
            f"liquid is {100 * contrast['liquid']:.0f} % as bright as the gel; use a clearer "
            "liquid, or average several scans",
        )
    ]
