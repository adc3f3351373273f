"""Find vessels closed by gel: occlusions with their ends, and missing vessels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.geometry.polyline import places_along
from registration.alignment import Fit
from registration.alignment.uncertainty import ScanErrors
from registration.measuring.gauging.changes import bordered, point_at
from registration.measuring.gauging.defect import Defect
from registration.measuring.gauging.trace import VesselTrace
from registration.segmentation import GelField

MISSING_SHARE = 0.9
"""A vessel closed over this much of what was seen of it, clear of junctions, is missing."""


@dataclass(frozen=True)
class Ends:
    """What ends of occlusions are measured with.

    Attributes
    ----------
    field : GelField
        The scan's gel, in which they are found along the lumen's own axis.
    fit : Fit
        Scan to part, with which the traces were made.
    wall_mm : float, mm
        How much further into the gel walls lie than the field says (`with_told_walls`).
    errors : ScanErrors
        Of those walls.
    """

    field: GelField
    fit: Fit
    wall_mm: float
    errors: ScanErrors

    @property
    def shared_mm(self) -> float:
        """Standard uncertainty that both ends share, mm."""
        errors = self.errors
        shared = (errors.level_mm, errors.faint_mm, errors.line_mm)
        return float(np.linalg.norm(shared))


def find_closures(traces: tuple[VesselTrace, ...], ends: Ends) -> list[Defect]:
    """Occlusions and missing vessels.

    Parameters
    ----------
    traces : tuple of VesselTrace
        One a vessel.
    ends : Ends
    """
    return [defect for trace in traces for defect in _closures(trace, ends)]


def _closures(trace: VesselTrace, measured: Ends) -> list[Defect]:
    closed = trace.seen & ~trace.sections.open
    if not closed.any():
        return []
    if is_missing(trace):
        return [_missing(trace, np.flatnonzero(closed))]
    closed_at = np.flatnonzero(closed)
    runs = np.split(closed_at, np.flatnonzero(np.diff(closed_at) > 1) + 1)
    return [_occlusion(trace, run, measured) for run in runs]


def is_missing(trace: VesselTrace) -> bool:
    """Whether a vessel is closed over nearly all that was seen of it."""
    # Where it lies within a junction's lumen even a missing vessel is free.
    own = trace.seen & (trace.apart | trace.short)
    closed = own & ~trace.sections.open
    return bool(own.any() and closed.sum() >= MISSING_SHARE * own.sum())


def _missing(trace: VesselTrace, closed: NDArray[np.int64]) -> Defect:
    half = trace.spacing / 2
    middle = float(trace.length / 2)
    return Defect(
        kind="missing",
        vessel=trace.vessel,
        other=None,
        from_mm=float(trace.along[closed[0]] - half),
        to_mm=float(trace.along[closed[-1]] + half),
        at_mm=middle,
        point_mm=point_at(trace, middle),
        size_um=2e3 * float(trace.radius.mean()),
        error_um=0.0,
        percent=float("nan"),
        wall_um=float("nan"),
        significance=float("inf"),
        seen=bool(trace.seen.all()),
    )


def _occlusion(trace: VesselTrace, run: NDArray[np.int64], measured: Ends) -> Defect:
    ends = [_end(trace, int(run[0]), -1, measured), _end(trace, int(run[-1]), 1, measured)]
    shared = 2 * measured.shared_mm
    middle = (ends[0][0] + ends[1][0]) / 2
    extent = (ends[0][0], ends[1][0])
    return Defect(
        kind="occlusion",
        vessel=trace.vessel,
        other=None,
        from_mm=extent[0],
        to_mm=extent[1],
        at_mm=middle,
        point_mm=point_at(trace, middle),
        size_um=1e3 * (extent[1] - extent[0]),
        error_um=1.96e3 * float(np.hypot(np.hypot(ends[0][1], ends[1][1]), shared)),
        percent=float("nan"),
        wall_um=float("nan"),
        significance=float("inf"),
        seen=bordered(trace, extent),
    )


def _end(trace: VesselTrace, station: int, way: int, measured: Ends) -> tuple[float, float]:
    """Where along the vessel the gel of a closed station ends in one direction, and its error.

    The level's crossing is looked for on a bundle of lines beside the lumen's axis, and moved into
    the gel as lumens' walls are; the bundle's scatter is the error, of as many lines as the blur σ
    leaves independent: an area π s² holds s²/(4 σ²) of its correlation's 4 π σ². Without a free
    neighbour the end lies half a spacing off.
    """
    field, fit = measured.field, measured.fit
    border, half = station + way, trace.spacing / 2
    plain = float(trace.along[station] + way * half)
    if not 0 <= border < len(trace.along) or not trace.sections.open[border]:
        return plain, half / np.sqrt(3)
    # Open sections beyond the blurred edge tell where the lumen's own axis runs.
    free = np.clip(border + way * np.arange(6), 0, len(trace.along) - 1)
    shift = (
        np.nanmedian(np.where(trace.counted[free], trace.sections.shift[free].T, np.nan), axis=1)
        if trace.counted[free].any()
        else np.zeros(2)
    )
    low, high = sorted((float(trace.along[station]), float(trace.along[free[2]])))
    along = np.arange(low, high, float(field.voxel_mm.min()) / 8)[::way]
    axis = places_along(trace.centre, trace.along, along)
    spread = 0.35 * trace.radius[station]
    pattern = shift + spread * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    across = trace.planes.across[border]
    values = np.stack([field.above_level(fit.invert(axis) + p @ across) for p in pattern])
    crossing = (values[:, :-1] >= 0) & (values[:, 1:] < 0)
    met = crossing.any(axis=1)
    if not met.any():
        return plain, half / np.sqrt(3)
    places = along[crossing[met].argmax(axis=1)] + way * float(field.voxel_mm.min()) / 16
    scatter = float(places.std(ddof=1)) if len(places) > 1 else half / np.sqrt(3)
    lines = np.clip(1 + (spread / max(2 * field.blur_mm, 1e-9)) ** 2, 1, len(places))
    along_light = float(np.cross(*across)[2])
    inwards = measured.wall_mm + field.facing_mm * along_light**2
    return float(np.median(places)) - way * inwards, scatter / float(np.sqrt(lines))
