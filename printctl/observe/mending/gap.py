"""Data classes of a gap in a written path and of an unmended stretch; locate and merge gaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from kernels.arrays import FloatArray
from printctl.observe.mending.held_print import MendError, WrittenPath, path_between

_SEAM_MM = 0.02


@dataclass(frozen=True)
class Gap:
    """Stretch without ink, or with too little.

    Attributes
    ----------
    path : int
        Number of the `WrittenPath`.
    from_mm, to_mm : float, mm
        Way along it.
    missing : float
        Share of the ink that isn't there: 1 for none at all.
    seen_height_mm : float or None, mm
        Of the ink that is there; None where the device doesn't see heights.
    shift_mm : float, mm
        How far what lies there may stand beside its place.
    flow : float
        Plunger over way against the path's own lines: what the flow has been corrected by since
        they were written.
    """

    path: int
    from_mm: float
    to_mm: float
    missing: float = 1.0
    seen_height_mm: float | None = None
    shift_mm: float = 0.0
    flow: float = 1.0

    @property
    def length_mm(self) -> float:
        """Along the path."""
        return self.to_mm - self.from_mm

    @property
    def whole(self) -> bool:
        """Whether nothing at all lies there."""
        return self.missing >= 1.0


@dataclass(frozen=True)
class NotMended:
    """Stretch that stays as it is, and why.

    Attributes
    ----------
    path : int
    from_mm, to_mm : float, mm
    reason : str
        In words found on the machine, with what to do.
    """

    path: int
    from_mm: float
    to_mm: float
    reason: str

    @property
    def length_mm(self) -> float:
        """Along the path."""
        return self.to_mm - self.from_mm


def gap_between(
    paths: Sequence[WrittenPath],
    places_mm: ArrayLike,
    command: int | None = None,
    *,
    missing: float = 1.0,
    flow: float = 1.0,
    within_mm: float = 0.5,
) -> Gap:
    """Return the gap that begins, passes and ends at places of the printer's frame.

    Parameters
    ----------
    paths : sequence of WrittenPath
    places_mm : (k, 3) array, mm
        Two at least; with a third between them a closed path's gap goes the right way round.
    command : int or None
        Command of the job that wrote there, from 0; it tells paths apart that lie side by side.
    missing, flow : float
        Of `Gap`.
    within_mm : float, mm
        Farthest from the path.

    Raises
    ------
    MendError
        When no written path is so near to all places.
    """
    places = np.asarray(places_mm, dtype=np.float64)
    if not paths or places.ndim != 2 or places.shape[1:] != (3,) or len(places) < 2:
        raise MendError("a gap has two places at least, (k, 3) mm, on what the job has written")
    path = path_between(paths, places, command)
    ways, off = (
        np.array(each) for each in zip(*(path.nearest_mm(place) for place in places), strict=True)
    )
    if off.max() > within_mm:
        raise MendError(
            f"the gap's end lies {off.max():.2f} mm beside the nearest written path, more than "
            f"{within_mm:g} mm: look again, or calibrate the frame (printctl observe frame)"
        )
    low, high = _span(path, ways)
    return Gap(path.number, low, high, missing, flow=flow)


def _span(path: WrittenPath, ways: FloatArray) -> tuple[float, float]:
    """From and to; where a closed path begins and ends, the side on which the others lie."""
    low, high = float(min(ways[0], ways[-1])), float(max(ways[0], ways[-1]))
    length = path.length_mm
    closed = np.linalg.norm(path.points[0] - path.points[-1]) < _SEAM_MM
    if not closed or min(low, length - high) > _SEAM_MM:
        return low, high
    seam_low, seam_high = low <= _SEAM_MM, high >= length - _SEAM_MM
    inner = ways[1:-1]
    if seam_low and (high <= _SEAM_MM or (len(inner) and float(np.median(inner)) > high)):
        return (0.0 if high <= _SEAM_MM else high), length
    if seam_high and len(inner) and float(np.median(inner)) < low:
        return 0.0, low
    return low, high


def check_gaps(gaps: Sequence[Gap], paths: Sequence[WrittenPath]) -> None:
    """Refuse gaps that aren't on the paths.

    Raises
    ------
    MendError
        For a path that the job hasn't written, a stretch that isn't on it, or shares beyond 0..1.
    """
    for gap in gaps:
        if not 0 <= gap.path < len(paths):
            raise MendError(
                f"a gap of path {gap.path}, and {len(paths)} are written: look again at this mark"
            )
        length = paths[gap.path].length_mm
        if not 0 <= gap.from_mm < gap.to_mm <= length + 1e-6:
            raise MendError(
                f"a gap from {gap.from_mm:g} to {gap.to_mm:g} mm isn't on path {gap.path}, "
                f"{length:.3f} mm long"
            )
        if not (0 < gap.missing <= 1 and 0 <= gap.shift_mm < np.inf and 0 < gap.flow < np.inf):
            raise MendError(
                f"a gap with {gap.missing:g} of its ink missing, {gap.shift_mm:g} mm beside its "
                f"place, at {gap.flow:g} of its flow; give a share above 0 up to 1, 0 mm or more, "
                "and a factor above 0"
            )


def merged(gaps: Sequence[Gap], paths: Sequence[WrittenPath], widths: float) -> list[Gap]:
    """Join gaps of one path that lie nearer to each other than so many widths of the line.

    Gaps of different kinds (whole and thin) stay apart, cut where they overlap.
    """
    joined: list[Gap] = []
    for gap in sorted(gaps, key=lambda one: (one.path, one.from_mm, one.to_mm)):
        if not joined or joined[-1].path != gap.path:
            joined.append(gap)
            continue
        last = joined[-1]
        near = widths * paths[gap.path].usual_width(last.to_mm, max(gap.from_mm, last.to_mm))
        if last.whole == gap.whole and gap.from_mm - last.to_mm < near:
            joined[-1] = _joined(last, gap)
        elif gap.from_mm < last.to_mm < gap.to_mm:
            joined.append(replace(gap, from_mm=last.to_mm))
        elif gap.to_mm > last.to_mm:
            joined.append(gap)
    return joined


def _missing(one: Gap, other: Gap) -> float:
    """Share that both miss in the mean; whole gaps miss all."""
    way = one.length_mm + other.length_mm
    return (one.missing * one.length_mm + other.missing * other.length_mm) / way


def _joined(one: Gap, other: Gap) -> Gap:
    heights = [g.seen_height_mm for g in (one, other) if g.seen_height_mm is not None]
    return Gap(
        one.path,
        one.from_mm,
        max(one.to_mm, other.to_mm),
        _missing(one, other),
        max(heights) if heights else None,
        max(one.shift_mm, other.shift_mm),
        max(one.flow, other.flow),
    )
