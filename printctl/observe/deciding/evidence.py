"""Data classes of inspection evidence: one look's gaps, widths, shift, and what it didn't see."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from printctl.observe.deciding.flow_control import FlowBlocks
from printctl.observe.deciding.ink_supply import InkSupply
from registration.inspection.values import Blob, Gap


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


@dataclass(frozen=True)
class UnseenPath:
    """A path, or a part of one, of which nothing is told.

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
        """Which path, how much of it and where."""
        if self.gap.length_mm > 0.98 * self.path_mm:
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
    way_mm : float, mm
        Written since the last look.
    coverage : float
        Share of the way that was seen on which ink lies; not a number where nothing was seen.
    unseen : tuple of UnseenPath
        Stretches longer than a tolerated gap, that no picture shows.
    shift_mm, u_shift_mm : float, mm
        How far the layer lies beside its place, and the standard uncertainty.
    narrowed : tuple of Narrowed
    stretches : int
        Lines surely thinner or wider than tolerated.
    thin : tuple of Thin
        Those surely too thin, which a second pass may fill up.
    seem_thin : tuple of Thin
        Those that seem so, by one picture: they are filled up where the flow is proven too small.
    level_mm : float or None, mm
        Height of the layer; None in a bath, where each look stands for itself.
    turned : str or None
        How the picture would fit the layer clearly better ("turned by 180°").
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
    way_mm: float = 1.0
    coverage: float = math.nan
    unseen: tuple[UnseenPath, ...] = ()
    shift_mm: float = 0.0
    u_shift_mm: float = 0.0
    narrowed: tuple[Narrowed, ...] = ()
    stretches: int = 0
    thin: tuple[Thin, ...] = ()
    seem_thin: tuple[Thin, ...] = ()
    level_mm: float | None = None
    turned: str | None = None
    map: MapCheck = field(default_factory=MapCheck)
    blobs: tuple[Blob, ...] = ()
    mends: bool = False
    alone: str = ""

    @property
    def unseen_mm(self) -> float:
        """Way that wasn't seen, mm."""
        return self.way_mm * (1.0 - self.seen_share)
