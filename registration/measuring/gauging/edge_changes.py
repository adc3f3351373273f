"""Drop apparent diameter changes at the edge of another defect, which are part of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from registration.measuring.gauging.defect import Defect
from registration.measuring.gauging.trace import VesselTrace


def drop_edge_changes(
    changes: Sequence[Defect], others: Sequence[Defect], traces: Sequence[VesselTrace]
) -> list[Defect]:
    """Return the changes that lie beside none of the other defects, within two sections."""
    return [
        change
        for change in changes
        if not any(_beside(change, other, traces[change.vessel]) for other in others)
    ]


def _beside(change: Defect, other: Defect, trace: VesselTrace) -> bool:
    if change.vessel not in (other.vessel, other.other):
        return False
    (low, high), reach = _extent(other, trace), 2 * trace.spacing
    return change.from_mm < high + reach and change.to_mm > low - reach


def _extent(defect: Defect, trace: VesselTrace) -> tuple[float, float]:
    """Where a defect lies along a vessel, mm; a bridge's other end about the nearest place."""
    if trace.vessel == defect.vessel:
        return defect.from_mm, defect.to_mm
    away = np.linalg.norm(trace.centre - np.array(defect.point_mm), axis=1)
    at, half = float(trace.along[np.argmin(away)]), 0.5e-3 * defect.size_um
    return at - half, at + half
