"""Data classes of inspection evidence: one inspection's gaps, widths, shift; layers seen so far."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from printctl.observe.deciding.flow_control import FlowBlocks
from printctl.observe.deciding.ink_supply import InkSupply
from registration.inspection.findings import ToldOfInk
from registration.inspection.values import Blob, Gap

# Data class of a line's thin stretch; keep those that a second picture confirms.


@dataclass(frozen=True)
class Thin:
    """Stretch of a path with too little ink.

    Attributes
    ----------
    stroke : int
        Number of the path.
    from_mm, to_mm : float, mm
        Along it.
    missing : float
        Share of the ink that was asked for, 0 to 1.
    """

    stroke: int
    from_mm: float
    to_mm: float
    missing: float

    @property
    def length_mm(self) -> float:
        """Along the path."""
        return self.to_mm - self.from_mm


def seen_twice(first: Sequence[Thin], second: Sequence[Thin]) -> tuple[Thin, ...]:
    """Return those of the first picture of which the second shows half at least."""
    return tuple(one for one in first if 2 * _common_mm(one, second) >= one.length_mm)


def _common_mm(one: Thin, others: Sequence[Thin]) -> float:
    own = [other for other in others if other.stroke == one.stroke]
    each = (min(one.to_mm, other.to_mm) - max(one.from_mm, other.from_mm) for other in own)
    return sum(max(0.0, length) for length in each)


@dataclass(frozen=True)
class MapCheck:
    """What tells whether a height map is whole.

    Attributes
    ----------
    lacks : str
        What it lacks, and against what, in words; empty for nothing.
    unsized : bool
        Whether nothing tells how many rows and columns it should have.
    sunk_mm : float, mm
        By how much the ground of the layer's ink has sunk at most, since it was designed.
    """

    lacks: str = ""
    unsized: bool = False
    sunk_mm: float = 0.0

    def worse(self, other: MapCheck) -> MapCheck:
        """Return what is to be said of two maps of one look."""
        return MapCheck(
            self.lacks or other.lacks,
            self.unsized or other.unsized,
            max(self.sunk_mm, other.sunk_mm),
        )


SURE: Final = 3.29
"""Standard uncertainties beyond the tolerance: one in 2,000 by chance, one-sided."""
_LISTED: Final = 3
"""Stretches that aren't seen, told by their places."""
_TOLD: Final = 0.1
"""Of the way, from which on it is said what isn't judged there."""
_SOME_MM: Final = 1.0
"""Way over older ink, less than which tells nothing of how ink shows there."""


@dataclass(frozen=True)
class Narrowed:
    """Lumen that is seen narrower than designed.

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

    def surely_below(self, share: float) -> bool:
        """Whether less than a share is open, beyond doubt."""
        return self.open_share + SURE * self.u < share


@dataclass(frozen=True)
class UnseenPath:
    """A path in a bath, or a part of one, of which nothing can be told.

    Attributes
    ----------
    name : str
        "vessel 2".
    gap : Gap
        What isn't seen of it.
    path_mm : float, mm
        Length of the whole path.
    bare : bool
        Whether that is all of it, nothing stands out from the bath there, and nothing hides it.
    """

    name: str
    gap: Gap
    path_mm: float
    bare: bool = False

    @property
    def words(self) -> str:
        """Which vessel, how much of it and where."""
        if self.bare:
            return f"{self.name} ({self.gap.length_mm:.1f} mm)"
        begin, end = (f"X {x:.1f} Y {y:.1f}" for x, y in (self.gap.start_mm, self.gap.end_mm))
        much = f"{self.gap.length_mm:.1f} of {self.path_mm:.1f} mm"
        return f"{much} of {self.name} ({begin} to {end})"


@dataclass(frozen=True)
class Evidence:
    """What a look has told.

    Attributes
    ----------
    places : int
        Places along lines that were tested.
    gaps : tuple of Gap
    second : tuple of Gap or None
        Those of a second picture; None where there is none.
    supply : InkSupply
    flow : FlowBlocks
    seen_share : float
        Of the way written since the last look.
    shift_mm, u_shift_mm : float, mm
        How far the layer lies beside its place, and the standard uncertainty.
    aside : bool
        Whether it surely lies beyond tolerance, however unsure by how much.
    narrowed : tuple of Narrowed
    stretches : int
        Lines surely thinner or wider than tolerated.
    thin : tuple of Thin
        Those surely too thin, which a second pass may fill up.
    seem_thin : tuple of Thin
        Those that seem so, by one picture: they are filled up where the flow is proven too small.
    over_old_share : float
        Of the way, not seen because it lies over older ink from which nothing tells it.
    way_mm : float, mm
        Written since the last look.
    coverage : float
        Share of the way that was seen on which ink lies; not a number where nothing was seen.
    level_mm : float or None, mm
        Height of the layer; None where there is none, and each look stands for itself.
    turned : str or None
        How the picture would fit the layer clearly better ("turned by 180°").
    unseen : tuple of UnseenPath
        Those of which more isn't seen than is tolerated.
    faint_share : float
        Of the way, on which ink shows, but gaps longer than a tolerated one alone do.
    hidden : tuple of UnseenPath
        Stretches in a bath, longer than a tolerated gap, that no picture shows.
    unplaced : tuple of Gap
        Missing by one of two places that the layer may have, and not by the other.
    half_seen : tuple of Gap
        Of the first picture's, those of which a second one of a layer sees less than half.
    beside_mm : float, mm
        Way of a line whose ink lies where none should.
    least_gap_mm : float, mm
        Shortest gap that surely shows in a profiler's map; 0 where it isn't known.
    by_height_share : float
        Of the way, seen over older ink, where heights tell gaps and no widths.
    waver : float
        Standard deviation of ink's height there, in thicknesses of the layer.
    low : tuple of Gap
        Stretches there whose ink stands lower than elsewhere by more than is tolerated of widths.
    older_mm, older_step, older_limit : float
        Way over older ink, mm; by what logarithm it changed since the picture before, and by what
        it may without ink; or NaN.
    told : ToldOfInk or None
        What all measures together tell of whether ink came; None where nobody said.
    untold_seams : float
        Share of the way that touches its neighbours and was seen, so that thin ink isn't told.
    map : MapCheck
        What is known of a height map's rows and columns.
    blobs : tuple of Blob
        What stands over the layer, in a profiler's map.
    mends : bool
        Whether the look is about mends alone.
    alone : str
        Why a second picture that was wanted didn't come; empty where none was, or it came.
    """

    places: int
    gaps: tuple[Gap, ...]
    second: tuple[Gap, ...] | None
    supply: InkSupply
    flow: FlowBlocks
    seen_share: float
    shift_mm: float = 0.0
    u_shift_mm: float = 0.0
    aside: bool = False
    narrowed: tuple[Narrowed, ...] = ()
    stretches: int = 0
    thin: tuple[Thin, ...] = ()
    seem_thin: tuple[Thin, ...] = ()
    over_old_share: float = 0.0
    way_mm: float = 1.0
    coverage: float = math.nan
    level_mm: float | None = None
    turned: str | None = None
    unseen: tuple[UnseenPath, ...] = ()
    faint_share: float = 0.0
    hidden: tuple[UnseenPath, ...] = ()
    unplaced: tuple[Gap, ...] = ()
    half_seen: tuple[Gap, ...] = ()
    beside_mm: float = 0.0
    least_gap_mm: float = 0.0
    by_height_share: float = 0.0
    waver: float = math.nan
    low: tuple[Gap, ...] = ()
    older_mm: float = 0.0
    older_step: float = math.nan
    older_limit: float = 0.02
    told: ToldOfInk | None = None
    untold_seams: float = 0.0
    map: MapCheck = field(default_factory=MapCheck)
    blobs: tuple[Blob, ...] = ()
    mends: bool = False
    alone: str = ""

    def unjudged_words(self, gap_mm: float, width_percent: float) -> str:
        """What tolerances a look doesn't judge though it sees, in words; empty for nothing.

        Parameters
        ----------
        gap_mm : float, mm
        width_percent : float
            Of its width, by which a line may be thinner or wider.
        """
        words = ""
        if self.untold_seams >= _TOLD:
            words += (
                f"; on {self.untold_seams:.0%} lines touch, and it isn't seen whether they are thin"
            )
        if self.least_gap_mm > gap_mm:
            words += (
                f"; gaps shorter than {self.least_gap_mm:.2f} mm may not show (gap_mm is "
                f"{gap_mm:g}): a finer map, or a higher gap_mm"
            )
        if self.by_height_share >= _TOLD and math.isfinite(self.waver):
            over = f", more than the {width_percent:g} % that widths may be off"
            words += (
                f"; on {self.by_height_share:.0%} (over older ink) gaps are told and no widths; "
                f"the ink's height wavers there by {self.waver:.0%} of a layer"
                f"{over * (100.0 * self.waver > width_percent)}"
            )
        return words + self._map_words + self.blob_words

    @property
    def _map_words(self) -> str:
        """What a height map lacks, and that it shows sunken ground; empty for neither."""
        lacks = f"; the map {self.map.lacks}" if self.map.lacks else ""
        if not self.map.sunk_mm > 0.0:
            return lacks
        return (
            f"{lacks}; what the layer lies on has sunk by up to {1e3 * self.map.sunk_mm:.0f} µm, "
            "and its ink is judged by its rise over that"
        )

    @property
    def blob_words(self) -> str:
        """Blobs on the layer, the largest first."""
        largest = sorted(self.blobs, key=lambda one: -one.area_mm2)
        if not largest:
            return ""
        each = [
            f"X {one.at_mm[0]:.1f} Y {one.at_mm[1]:.1f}, {one.width_mm:.2f} mm wide, "
            f"{1e3 * one.height_mm:.0f} µm over the ink"
            for one in largest[:_LISTED]
        ]
        more = f" and {len(largest) - _LISTED} smaller" if len(largest) > _LISTED else ""
        many = "1 blob stands" if len(largest) == 1 else f"{len(largest)} blobs stand"
        return f"; {many} on the layer ({'; '.join(each)}{more})"

    @property
    def came_words(self) -> str:
        """Where the picture changed as fresh ink changes it, though no gaps are told there."""
        came_mm = 0.0 if self.told is None else self.told.came_mm
        if came_mm < _SOME_MM:
            return ""
        untold_mm = 0.0 if self.told is None else self.told.thin_untold_mm
        thin = f", nor along {untold_mm:.1f} mm whether it is thin" * (untold_mm >= _SOME_MM)
        return (
            f"; along {came_mm:.1f} mm the picture changed as by fresh ink: gaps aren't told{thin}"
        )

    @property
    def bare_words(self) -> str:
        """What is told of a look that sees hardly anything else."""
        return self.hidden_words + self.blob_words

    @property
    def hidden_words(self) -> str:
        """The longest stretches that no picture shows, in words; empty where there is none."""
        longest = sorted(self.hidden, key=lambda one: -one.gap.length_mm)
        words = [one.words for one in longest[:_LISTED]]
        more = f" and {len(longest) - _LISTED} shorter" if len(longest) > _LISTED else ""
        return f": {', '.join(words)}{more}" if words else ""
