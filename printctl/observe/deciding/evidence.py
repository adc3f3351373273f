"""Data classes of inspection evidence: one inspection's gaps, widths, shift; layers seen so far."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from printctl.observe.deciding.flow_control import FlowBlocks
from printctl.observe.deciding.ink_supply import InkSupply
from printctl.observe.deciding.thin import Thin
from registration.layer_images.values import Gap, ToldOfInk

SURE: Final = 3.29
"""Standard uncertainties beyond the tolerance: one in 2,000 by chance, one-sided."""
_LISTED: Final = 3
"""Stretches that aren't seen, told by their places."""
_SHOWS: Final = 0.3
"""Of a layer's way, on which grainy or faint ink shows, for ink to have come at all."""
_TOLD: Final = 0.1
"""Of the way over older ink, from which on it is said what isn't judged there."""
_HIDDEN: Final = 0.1
"""Of a layer so little could be seen at best that a look says nothing about the view."""
_FIRST_MM: Final = 5.0
"""Way of lines of which some must be seen: of the print's first, and later of those that change
older ink's level."""
_SOME_MM: Final = 1.0
"""Way over older ink, less than which tells nothing of how ink shows there."""
_GROUNDS: Final = 3.0
"""Times what the ground's own change reaches: less may be no ink."""
_DRYING: Final = 0.01
"""And what older ink may change by in drying, otherwise than the ground (0.008 was seen)."""
_SURELY: Final = 20.0
"""Times the ground's own change: so much shows ink though nothing of it is seen."""
_BLIND_MM: Final = 20.0
"""Way of lines in a row of which nothing is told, after which the operator is."""
_JOINED_MM: Final = 1.0
"""Way without ink at a look's begin that joins it to what the looks before left untold."""
_UNCHANGED: Final = 0.1
"""Of what fresh ink changed last: less, and nothing has come. Each layer shows as much of what the
one before did as ink lets light through; inks of which that is less are opaque by the third."""


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
    older_mm, older_step, older_limit : float
        Way over older ink, mm; by what logarithm it changed since the picture before, and by what
        it may without ink; or NaN.
    told : ToldOfInk or None
        What all measures together tell of whether ink came; None for mends alone.
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

    def unjudged_words(self, gap_mm: float, width_percent: float) -> str:
        """What tolerances a profiler's map doesn't judge, in words; empty for nothing.

        Parameters
        ----------
        gap_mm : float, mm
        width_percent : float
            Of its width, by which a line may be thinner or wider.
        """
        words = ""
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
        return words

    older_mm: float = 0.0
    older_step: float = math.nan
    older_limit: float = 0.01
    told: ToldOfInk | None = None

    @property
    def came_words(self) -> str:
        """Where the picture changed as fresh ink changes it, though no gaps are told there."""
        came_mm = 0.0 if self.told is None else self.told.came_mm
        if came_mm < _SOME_MM:
            return ""
        return f"; along {came_mm:.1f} mm the picture changed as by fresh ink: gaps aren't told"

    @property
    def hidden_words(self) -> str:
        """The longest stretches that no picture shows, in words; empty where there is none."""
        longest = sorted(self.hidden, key=lambda one: -one.gap.length_mm)
        words = [one.words for one in longest[:_LISTED]]
        more = f" and {len(longest) - _LISTED} shorter" if len(longest) > _LISTED else ""
        return f": {', '.join(words)}{more}" if words else ""


@dataclass
class LayersSeen:
    """How much was seen of the layer in hand, and how many in a row too little was seen of.

    Attributes
    ----------
    unseen : int
        In a row, the one in hand included.
    before : int
        Without the one in hand.
    level_mm : float or None, mm
    way_mm, visible_mm, seen_mm, came_mm : float, mm
        Of the layer in hand: written; what a clean view can show of it; seen; changed as by ink.
    first_mm : float or None, mm
        Way written in layers while no ink was seen at all; None once some was, or that was told.
    failed : bool
        Whether ink stopped coming for a while, and nobody was told since that layers are hidden.
    older_step : float
        Logarithm by which fresh ink last changed the picture of older ink; 0 where it hardly does.
    blank_mm : float, mm
        Way in a row since, over older ink, of which nothing was seen and which hasn't changed.
    blank : list of Gap
        Of that, what nothing told of, with what the look before it left untold.
    tail : list of Gap
        What nothing told of since the last place with ink, in the order of writing.
    before_tail : list of Gap
        The same at the look before, where that goes on without ink.
    blind_said : bool
        Whether it was said that nothing tells of such ink.
    """

    unseen: int = 0
    before: int = 0
    level_mm: float | None = None
    way_mm: float = 0.0
    visible_mm: float = 0.0
    seen_mm: float = 0.0
    came_mm: float = 0.0
    first_mm: float | None = 0.0
    failed: bool = False
    older_step: float = 0.0
    blank_mm: float = 0.0
    blank: list[Gap] = field(default_factory=list)
    tail: list[Gap] = field(default_factory=list)
    before_tail: list[Gap] = field(default_factory=list)
    blind_said: bool = False

    @property
    def hidden(self) -> bool:
        """Whether nearly all of the layer in hand lies over ink from which it can't be told."""
        return self.visible_mm < _HIDDEN * self.way_mm

    @property
    def untellable(self) -> bool:
        """Whether it is hidden, and what changed tells hardly of any ink either."""
        return self.hidden and self.came_mm < 0.5 * self.way_mm

    def add(self, evidence: Evidence, least_share: float) -> None:
        """Take in a look; several in one layer count as one."""
        if self.first_mm is not None and evidence.level_mm is not None:
            visible_mm = evidence.way_mm * (1.0 - evidence.over_old_share)
            shows = evidence.seen_share > 0 or evidence.faint_share > _SHOWS
            self.first_mm = None if shows else self.first_mm + visible_mm
        self._add_older(evidence)
        self._add_tail(evidence)
        if evidence.level_mm is None or evidence.level_mm != self.level_mm:
            self.before, self.level_mm = self.unseen, evidence.level_mm
            self.way_mm = self.visible_mm = self.seen_mm = self.came_mm = 0.0
        self.way_mm += evidence.way_mm
        came_mm = 0.0 if evidence.told is None else evidence.told.came_mm
        self.came_mm += came_mm
        self.visible_mm += evidence.way_mm * (1.0 - evidence.over_old_share)
        self.seen_mm += evidence.way_mm * evidence.seen_share
        # No cleaner view would show a hidden one.
        counts = self.hidden or self.seen_mm >= least_share * self.visible_mm
        self.unseen = 0 if counts else self.before + 1

    def _add_older(self, evidence: Evidence) -> None:
        """Take in whether older ink changed; where it does less by and by, ink is opaque."""
        step, shows = evidence.older_step, evidence.seen_share + evidence.faint_share > 0.0
        if evidence.older_mm < _SOME_MM or math.isnan(step):
            return
        ground, last = evidence.older_limit, self.older_step
        if not shows and step < min(_UNCHANGED * last, max(_GROUNDS * ground, _DRYING)):
            if last > _GROUNDS * ground:
                self._add_blank(evidence)
            return
        most = step if shows or step > _SURELY * ground else min(step, last)
        self.blank_mm, self.blank = 0.0, []
        self.older_step = most if step >= _GROUNDS * ground else 0.0

    def _add_blank(self, evidence: Evidence) -> None:
        """Take in a look in which nothing changed, with what the look before it left untold."""
        if not self.blank_mm:
            self.blank = list(self.tail)
        self.blank_mm += evidence.older_mm
        self.blank += () if evidence.told is None else evidence.told.untold

    def _add_tail(self, evidence: Evidence) -> None:
        """Take in what nothing tells of, behind the last place with ink."""
        told = evidence.told
        if told is None or evidence.level_mm is None:
            return
        any_ink = told.ink_mm > 0
        joined = not any_ink or told.head_mm >= _JOINED_MM
        self.before_tail = self.tail if joined else []
        self.tail = [*([] if any_ink else self.tail), *told.tail]

    def none_yet(self) -> str:
        """Say once that no ink was seen so far: none can be known by its look then."""
        if self.first_mm is None or self.first_mm < _FIRST_MM:
            return ""
        way_mm, self.first_mm = self.first_mm, None
        return (
            f"no ink is seen yet where {way_mm:.0f} mm of lines should lie: the needle is clogged, "
            "the syringe empty, or the device can't tell this ink from what lies around it; look "
            "before you go on"
        )

    def none_any_more(self) -> tuple[str, tuple[Gap, ...]]:
        """Say once that older ink doesn't change any more where fresh ink should lie on it.

        With the stretches of which nothing tells that ink came.
        """
        if self.blank_mm < _FIRST_MM:
            return "", ()
        way_mm, stretches = self.blank_mm, tuple(self.blank)
        self.blank_mm, self.older_step, self.blank, self.tail = 0.0, 0.0, [], []
        return (
            f"nothing has changed along the last {way_mm:.0f} mm over older ink, though fresh ink "
            "showed there before: the needle is clogged or the syringe empty"
            f"{where(stretches)}; look before you go on",
            stretches,
        )

    def blind(self) -> str:
        """Say once that nothing tells of what was written for long."""
        way_mm = math.fsum(one.length_mm for one in self.tail)
        if self.blind_said or way_mm < _BLIND_MM:
            return ""
        words = where(self.tail)
        self.blind_said, self.tail = True, []
        return (
            f"nothing tells whether ink lies on the last {way_mm:.0f} mm{words}: ink on older ink "
            "of its own look, light or grain hides it; look whether it is there; the print goes on "
            "without a word where that stays so"
        )

    def untold(self) -> tuple[Gap, ...]:
        """Return what the looks before left untold directly in front of ink that doesn't come."""
        return tuple(self.before_tail)


def where(stretches: Sequence[Gap]) -> str:
    """From where to where stretches run, in the order of writing, in words; empty for none."""
    if not stretches:
        return ""
    begin, end = stretches[0].start_mm, stretches[-1].end_mm
    places = (f"X {x:.1f} Y {y:.1f}" for x, y in (begin, end))
    way_mm = math.fsum(one.length_mm for one in stretches)
    return f" ({' to '.join(places)}, {way_mm:.1f} mm)"
