"""Excess width and axis shift of each vessel of a print, as input of a compensation.

Sections whose number was withdrawn are left out. Defects (occlusions, leaks, missing vessels, local
bulges and stenoses) are accidents of one print or faults to be mended. Their places are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from design.network import VesselNetwork
from design.toolpath.correction import Corrections, Stretch
from kernels.arrays import BoolArray, FloatArray
from printctl.corrections.feedback.evidence import Print

WHOLE_VESSEL = 0.8
"""A change over more of a vessel's sections than this is the vessel's own size."""
LEAST_SECTIONS = 5
"""Of a vessel that is told by itself: a few between two junctions may be the junctions'."""


@dataclass(frozen=True)
class Reading:
    """One vessel in one print, after the stretch that will be applied is taken out.

    Attributes
    ----------
    vessel : int
    diameter_mm : float, mm
        Designed, mean over the sections.
    sections : int
        Used.
    excess_mm, error_mm : float, mm
        Printed less designed diameter, and its standard error by the sections' scatter.
    ends_mm : (2, 3) float64 or None, mm
        The axis' offset, across the vessel, at its first and last node by a line through the
        sections; None where too few of them tell.
    ends_error_mm : (2,) float64, mm
        Standard errors of each component.
    """

    vessel: int
    diameter_mm: float
    sections: int
    excess_mm: float
    error_mm: float
    ends_mm: FloatArray | None
    ends_error_mm: FloatArray


def readings(print_: Print, stretch: Stretch, whole_changes: bool) -> dict[int, Reading]:
    """Every vessel of which enough was seen.

    Parameters
    ----------
    print_ : Print
    stretch : Stretch
        That the next print will be written with; diameters are told as that print's.
    whole_changes : bool
        Whether a vessel that is narrow or wide over all of its length counts as it is: several
        prints can tell that from an accident, one can't.
    """
    measured = (
        _reading(row, print_, stretch, _left_out(print_.found["defects"], row, whole_changes))
        for row in print_.found["vessels"]
    )
    return {reading.vessel: reading for reading in measured if reading is not None}


def rebase_reading(reading: Reading, print_: Print, bases: Sequence[Corrections]) -> Reading:
    """A reading as it would be, had its print been made with the mean of ``bases``."""
    vessel, wide = reading.vessel, np.array([reading.diameter_mm])

    def more(base: Corrections) -> float:
        return 2 * float(base.radial(wide)[0]) + base.diameter_mm.get(vessel, 0.0)

    def moved(base: Corrections) -> FloatArray:
        nodes = print_.network.vessel_nodes[vessel].tolist()
        return np.array([base.offset_mm.get(node, (0.0, 0.0, 0.0)) for node in nodes])

    excess = reading.excess_mm + float(np.mean([more(base) for base in bases])) - more(print_.base)
    ends = reading.ends_mm
    if ends is not None:
        ends = ends + np.mean([moved(base) for base in bases], axis=0) - moved(print_.base)
    return replace(reading, excess_mm=excess, ends_mm=ends)


def _reading(
    row: dict[str, Any], print_: Print, stretch: Stretch, left_out: BoolArray
) -> Reading | None:
    vessel = int(row["vessel"])
    along = np.array(row["along_mm"], dtype=np.float64)
    measured = np.array(row["diameter_um"], dtype=np.float64) * 1e-3
    noise = np.nan_to_num(np.array(row["noise_um"], dtype=np.float64) * 1e-3)
    kept = np.isfinite(measured) & (measured > 0) & ~left_out & _not_withdrawn(row)
    if not kept.any():
        return None
    designed, way = _designed(print_.network, vessel, along[kept])
    ratio = stretch.across(way) / print_.base.stretch.across(way)
    excess = measured[kept] * ratio - designed
    worth = _worth(along[kept], float(designed.mean()))
    scatter = float(np.std(excess, ddof=1)) if kept.sum() > 1 else 0.0
    own = float(np.sqrt(np.mean(noise[kept] ** 2)))
    shift = np.array(row["shift_along_um"], dtype=np.float64).reshape(-1, 3)[kept] * 1e-3
    ends, ends_error = _ends(along[kept], shift, float(row["length_mm"]), worth)
    return Reading(
        vessel=vessel,
        diameter_mm=float(designed.mean()),
        sections=int(kept.sum()),
        excess_mm=float(excess.mean()),
        error_mm=float(np.hypot(scatter, own if kept.sum() < 3 else 0.0) / np.sqrt(worth)),
        ends_mm=ends,
        ends_error_mm=ends_error,
    )


def _not_withdrawn(row: dict[str, Any]) -> BoolArray:
    """Sections whose diameter has an interval: a number that was withdrawn corrects nothing."""
    count = len(row["along_mm"])
    halves = row.get("interval_95_um") or [0.0] * count  # an older registration's
    return np.array([half is not None for half in halves], dtype=np.bool_)


def _worth(along: FloatArray, diameter: float) -> float:
    """How many sections' worth there is: what is nearer than a diameter errs together."""
    span = float(np.ptp(along))
    return max(1.0, min(float(len(along)), span / diameter))


def _designed(
    network: VesselNetwork, vessel: int, along: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Designed diameter (n,) and unit direction (n, 3) at distances along a vessel."""
    points, radius = network.polyline(vessel)
    ways = np.diff(points, axis=0)
    steps = np.linalg.norm(ways, axis=1)
    path = np.concatenate([[0.0], np.cumsum(steps)])
    piece = np.clip(np.searchsorted(path, along, side="right") - 1, 0, len(steps) - 1)
    way = ways[piece] / np.maximum(steps[piece], 1e-12)[:, None]
    return 2 * np.interp(along, path, radius), np.asarray(way)


def _ends(
    along: FloatArray, shift: FloatArray, length: float, worth: float
) -> tuple[FloatArray | None, FloatArray]:
    """Offset at both ends by least squares, and standard errors of its components."""
    known = np.isfinite(shift).all(axis=1)
    if known.sum() < LEAST_SECTIONS:
        return None, np.full(2, np.inf)
    s, y = along[known] - along[known].mean(), shift[known]
    square = float((s**2).sum())
    slope = (s[:, None] * y).sum(axis=0) / max(square, 1e-12)
    rest = y - y.mean(axis=0) - s[:, None] * slope
    scatter = float(np.sqrt((rest**2).sum() / max(2 * (len(s) - 2), 1)))
    at = np.array([0.0, length]) - along[known].mean()
    ends = y.mean(axis=0) + at[:, None] * slope
    spread = at**2 / max(square / len(s), 1e-12)
    return ends, scatter * np.sqrt((1 + spread) / worth)


def _left_out(
    defects: Sequence[dict[str, Any]], row: dict[str, Any], whole_changes: bool
) -> BoolArray:
    """Sections in a defect or at its brink; not those beyond a limit as their whole vessel is."""
    along = np.array(row["along_mm"], dtype=np.float64)
    out = np.zeros(len(along), dtype=np.bool_)
    reach = float(np.median(np.diff(along))) if len(along) > 1 else 0.0
    for defect in defects:
        if row["vessel"] not in (defect["vessel"], defect["other"]):
            continue
        if not defect.get("local", True):
            continue  # as the rest of its vessel: what is to be corrected
        if defect["kind"] in ("leak", "bridge"):
            # Its place along the other vessel isn't given: none of that is used.
            whole = defect["vessel"] != row["vessel"]
            near = np.abs(along - defect["at_mm"]) < 3 * reach + defect["size_um"] * 1e-3
            out |= np.ones_like(out) if whole else near
            continue
        change = defect["kind"] in ("bulge", "stenosis")
        if change and whole_changes and _within(along, defect, reach).mean() > WHOLE_VESSEL:
            continue
        # Of a run with changes within it only these differ from the rest of their vessel.
        for part in defect.get("changes", (defect,)):
            out |= _within(along, part, reach)
    return out


def _within(along: FloatArray, extent: dict[str, Any], reach: float) -> BoolArray:
    return (along > extent["from_mm"] - reach) & (along < extent["to_mm"] + reach)
