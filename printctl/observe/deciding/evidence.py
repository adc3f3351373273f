"""Evidence of one inspection: gaps, widths, shift, ink supply, and what wasn't seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.inspection.values import Blob, Gap
from printctl.observe.deciding.flow_control import FlowBlocks

BARE_INK_SHARE: Final = 0.5
"""Share of ink below which a place counts as bare."""
_MIN_STOPPED_SEEN_SHARE: Final = 0.5
"""Share of the ink written since it stopped that must be seen missing: where a picture shows bare
places alone, as over older ink, those would look like a stop."""
_MIN_STOPPED_VOLUMES: Final = 10.0
"""Times the tolerated volume that must be missing at the end: less is the taper of a line's end."""
_MIN_BARE_SHARE: Final = 0.8
"""Share of a run's seen places that must lack ink."""


class SupplyState(StrEnum):
    """State of needle and syringe, inferred from missing ink."""

    FLOWING = "flowing"
    BUBBLE = "bubble"
    LOST_LINE = "lost line"
    CLOGGED = "clogged"
    EMPTY = "empty"
    INTERMITTENT = "intermittent"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class InkSupply:
    """State of the ink supply (`judge_supply`).

    Attributes
    ----------
    state : SupplyState
    since_ul : float or None, µL
        Requested since the ink last came, if it hasn't come back.
    """

    state: SupplyState
    since_ul: float | None = None

    @property
    def stopped(self) -> bool:
        """Whether no ink comes out of the needle any more."""
        return self.state in (SupplyState.CLOGGED, SupplyState.EMPTY)


def judge_supply(
    volume_ul: FloatArray,
    present: FloatArray,
    seen: BoolArray,
    stroke: IntArray,
    *,
    least_ul: float,
    left_ul: float | None = None,
) -> InkSupply:
    """Distinguish clog, empty syringe, bubble and lost line by where ink is missing.

    What is seen along the lines is put in the order of writing. Ink that is missing up to the last
    place written hasn't come back: the syringe is empty if the plunger says so, else something is
    stuck. Only where exactly one path is missing behind sound ones it may as well be a line that
    didn't stick; the next look decides. Ink that came back after a while was a bubble, or, where
    exactly one path is missing, a line that didn't stick. A smooth deviation is none of these: the
    flow control's affair.

    Parameters
    ----------
    volume_ul : (n,) float64, µL
        Requested at each place.
    present : (n,) float64
        0 (no ink) to 1.
    seen : (n,) bool
        Places that the picture shows; the others are skipped.
    stroke : (n,) int64
        Unbroken path of each place.
    least_ul : float, µL
        Runs of less are within tolerance.
    left_ul : float, optional, µL
        What the plunger still had before the last of these places; None if unknown.
    """
    if not seen.any():
        return InkSupply(SupplyState.UNKNOWN)
    volume, lacks, path = volume_ul[seen], present[seen] < BARE_INK_SHARE, stroke[seen]
    runs = [run for run in _runs(lacks) if volume[run].sum() >= least_ul]
    if not runs:
        return InkSupply(SupplyState.FLOWING)
    last = runs[-1]
    empty = left_ul is not None and left_ul <= least_ul
    lost = last.start > 0 and _whole_path(last, path) and not empty
    since_ul = float(volume_ul[np.flatnonzero(seen)[last.start] :].sum())
    stopped = volume[last].sum() >= max(
        _MIN_STOPPED_VOLUMES * least_ul, _MIN_STOPPED_SEEN_SHARE * since_ul
    )
    if last.stop == len(lacks) and stopped and not lost:
        state = SupplyState.EMPTY if empty else SupplyState.CLOGGED
        return InkSupply(state, float(volume[last].sum()))
    if len(runs) > 2:
        return InkSupply(SupplyState.INTERMITTENT)
    each_path = all(_whole_path(run, path) for run in runs)
    return InkSupply(SupplyState.LOST_LINE if each_path else SupplyState.BUBBLE)


def _runs(lacks: BoolArray) -> list[slice]:
    """Return stretches without ink; single places with or without don't end one."""
    smooth = lacks.copy()
    if len(lacks) > 2:
        between = (lacks[:-2] == lacks[2:]) & (lacks[1:-1] != lacks[2:])
        smooth[1:-1] = np.where(between, lacks[2:], lacks[1:-1])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], smooth, [False]]).astype(np.int8)))
    runs = [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
    return [
        run for run in runs if lacks[run].mean() >= _MIN_BARE_SHARE or run.stop - run.start <= 2
    ]


def _whole_path(run: slice, path: IntArray) -> bool:
    """Return whether a run is one path, from its first to its last place."""
    own = np.flatnonzero(path == path[run.start])
    return bool(own[0] == run.start and own[-1] == run.stop - 1)


@dataclass(frozen=True)
class ThinStretch:
    """Stretch of a path with too little ink.

    Attributes
    ----------
    stroke : int
        Number of the path.
    from_mm, to_mm : float, mm
        Along it.
    missing : float
        Share of the requested ink, 0 to 1.
    """

    stroke: int
    from_mm: float
    to_mm: float
    missing: float

    @property
    def length_mm(self) -> float:
        """Along the path."""
        return self.to_mm - self.from_mm


def confirm_thin(
    first: Sequence[ThinStretch], second: Sequence[ThinStretch]
) -> tuple[ThinStretch, ...]:
    """Return the first picture's thin stretches of which the second shows half or more."""
    return tuple(one for one in first if 2 * _common_mm(one, second) >= one.length_mm)


def _common_mm(one: ThinStretch, others: Sequence[ThinStretch]) -> float:
    own = [other for other in others if other.stroke == one.stroke]
    each = (min(one.to_mm, other.to_mm) - max(one.from_mm, other.from_mm) for other in own)
    return sum(max(0.0, length) for length in each)


@dataclass(frozen=True)
class MapCheck:
    """Completeness check of a height map.

    Attributes
    ----------
    lacks : str
        What it lacks, and against what, in words; empty for nothing.
    unsized : bool
        Whether the number of rows and columns that it should have is unknown.
    sunk_mm : float, mm
        By how much the ground of the layer's ink has sunk at most, since it was designed.
    """

    lacks: str = ""
    unsized: bool = False
    sunk_mm: float = 0.0

    def combine(self, other: MapCheck) -> MapCheck:
        """Return the combined check of two maps of one look."""
        return MapCheck(
            self.lacks or other.lacks,
            self.unsized or other.unsized,
            max(self.sunk_mm, other.sunk_mm),
        )


@dataclass(frozen=True)
class NarrowedLumen:
    """Lumen with its seen width over the designed one.

    Attributes
    ----------
    name : str
    open_share : float
        Seen over designed width; 0 for closed.
    u : float
        Standard uncertainty of it.
    """

    name: str
    open_share: float
    u: float


@dataclass(frozen=True)
class UnseenPath:
    """Path, or part of one, that no picture shows.

    Attributes
    ----------
    name : str
        "vessel 2".
    gap : Gap
        What isn't seen of it.
    path_mm : float, mm
        Length of the whole path.
    """

    name: str
    gap: Gap
    path_mm: float

    @property
    def words(self) -> str:
        """Name, length and place of the stretch."""
        if self.gap.length_mm > 0.98 * self.path_mm:
            return f"{self.name} ({self.gap.length_mm:.1f} mm)"
        begin, end = (f"X {x:.1f} Y {y:.1f}" for x, y in (self.gap.start_mm, self.gap.end_mm))
        much = f"{self.gap.length_mm:.1f} of {self.path_mm:.1f} mm"
        return f"{much} of {self.name} ({begin} to {end})"


@dataclass(frozen=True)
class Evidence:
    """Evidence of one look.

    Attributes
    ----------
    places : int
        Places along lines that were tested.
    gaps : tuple of Gap
    second_gaps : tuple of Gap or None
        Those of a second picture; None where there is none.
    supply : InkSupply
    flow : FlowBlocks
    seen_share : float
        Of the way written since the last look.
    way_mm : float, mm
        Written since the last look.
    coverage : float
        Share of the way that was seen on which ink lies; not a number where nothing was seen.
    unseen : tuple of UnseenPath
        Stretches longer than a tolerated gap, that no picture shows.
    shift_mm, u_shift_mm : float, mm
        How far the layer lies beside its place, and the standard uncertainty.
    narrowed : tuple of NarrowedLumen
    stretches : int
        Lines surely thinner or wider than tolerated.
    thin : tuple of ThinStretch
        Those surely too thin, which a second pass may fill up.
    seem_thin : tuple of ThinStretch
        Those that seem so, by one picture: they are filled up where the flow is proven too small.
    level_mm : float or None, mm
        Height of the layer; None in a bath, where each look stands for itself.
    turned : str or None
        How the picture would fit the layer clearly better ("turned by 180°").
    map : MapCheck
        What is known of a height map's rows and columns.
    blobs : tuple of Blob
        What stands over the layer, in a profiler's map.
    mends_only : bool
        Whether the look is about mends alone.
    single_picture_reason : str
        Why a second picture that was wanted didn't come; empty where none was, or it came.
    """

    places: int
    gaps: tuple[Gap, ...]
    second_gaps: tuple[Gap, ...] | None
    supply: InkSupply
    flow: FlowBlocks
    seen_share: float
    way_mm: float = 1.0
    coverage: float = math.nan
    unseen: tuple[UnseenPath, ...] = ()
    shift_mm: float = 0.0
    u_shift_mm: float = 0.0
    narrowed: tuple[NarrowedLumen, ...] = ()
    stretches: int = 0
    thin: tuple[ThinStretch, ...] = ()
    seem_thin: tuple[ThinStretch, ...] = ()
    level_mm: float | None = None
    turned: str | None = None
    map: MapCheck = field(default_factory=MapCheck)
    blobs: tuple[Blob, ...] = ()
    mends_only: bool = False
    single_picture_reason: str = ""

    @property
    def unseen_mm(self) -> float:
        """Way that wasn't seen, mm."""
        return self.way_mm * (1.0 - self.seen_share)
