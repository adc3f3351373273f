"""Stretch of a written path where ink is missing, and stretches that aren't mended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from printctl.observe.mending.errors import MendError
from printctl.observe.mending.written_paths import WrittenPath, path_between


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
    start_mm: ArrayLike,
    end_mm: ArrayLike,
    command: int | None = None,
    *,
    missing: float = 1.0,
    flow: float = 1.0,
    within_mm: float = 0.5,
) -> Gap:
    """Return the gap between two places of the printer's frame, as a look finds it.

    Parameters
    ----------
    paths : sequence of WrittenPath
    start_mm, end_mm : (3,) array, mm
    command : int or None
        Command of the job that wrote there, from 0; it tells paths apart that lie side by side.
    missing, flow : float
        Of `Gap`.
    within_mm : float, mm
        Farthest from the path.

    Raises
    ------
    MendError
        When no written path is so near to both places.
    """
    if not paths:
        raise MendError("the job has written nothing yet; there is no gap to mend")
    start, end = (np.asarray(each, dtype=np.float64) for each in (start_mm, end_mm))
    path = path_between(paths, start, end, command)
    ways, off = zip(path.nearest_mm(start), path.nearest_mm(end), strict=True)
    if max(off) > within_mm:
        raise MendError(
            f"the gap's end lies {max(off):.2f} mm beside the nearest written path, more than "
            f"{within_mm:g} mm: look again, or calibrate the frame (printctl observe frame)"
        )
    return Gap(path.number, min(ways), max(ways), missing, flow=flow)


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
    found: list[Gap] = []
    for gap in sorted(gaps, key=lambda one: (one.path, one.from_mm, one.to_mm)):
        if not found or found[-1].path != gap.path:
            found.append(gap)
            continue
        last = found[-1]
        near = widths * paths[gap.path].usual_width(last.to_mm, max(gap.from_mm, last.to_mm))
        if last.whole == gap.whole and gap.from_mm - last.to_mm < near:
            found[-1] = _joined(last, gap)
        elif gap.from_mm < last.to_mm < gap.to_mm:
            found.append(replace(gap, from_mm=last.to_mm))
        elif gap.to_mm > last.to_mm:
            found.append(gap)
    return found


def _joined(one: Gap, other: Gap) -> Gap:
    heights = [g.seen_height_mm for g in (one, other) if g.seen_height_mm is not None]
    return Gap(
        one.path,
        one.from_mm,
        max(one.to_mm, other.to_mm),
        max(one.missing, other.missing),
        max(heights) if heights else None,
        max(one.shift_mm, other.shift_mm),
        max(one.flow, other.flow),
    )
