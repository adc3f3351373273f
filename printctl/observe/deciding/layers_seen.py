"""Remember how much was seen of layers so far, and what nothing told of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from printctl.observe.deciding.evidence import Evidence
from registration.inspection.values import Gap

_SHOWS: Final = 0.3
"""Of a layer's way, on which grainy or faint ink shows, for ink to have come at all."""
_CAME: Final = 0.5
"""Of a layer's way, along which the picture changed as by ink, for ink to have come."""
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
_SURELY: Final = 6.0
"""Times the ground's own change: so much shows ink though nothing of it is seen."""
_BLIND_MM: Final = 20.0
"""Way of lines in a row of which nothing is told, after which the operator is."""
_JOINED_MM: Final = 1.0
"""Way without ink at a look's begin that joins it to what the looks before left untold."""
_UNCHANGED: Final = 0.1
"""Of what fresh ink changed last: less, and nothing has come. Each layer shows as much of what the
one before did as ink lets light through; inks of which that is less are opaque by the third."""


@dataclass
class LayersSeen:
    """How much was seen of the layer in hand, and how many in a row too little was seen of.

    Attributes
    ----------
    unseen : int
        In a row, the one in hand included.
    before : int
        Without the one in hand.
    unseen_said : int
        How many of them there were when the operator was last told.
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
    unseen_said: int = 0
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
        return self.hidden and self.came_mm < _CAME * self.way_mm

    def add(self, evidence: Evidence, least_share: float) -> None:
        """Take in a look; several in one layer count as one."""
        if self.first_mm is not None and evidence.level_mm is not None:
            visible_mm = evidence.way_mm * (1.0 - evidence.over_old_share)
            came = evidence.told is not None and evidence.told.came_mm > _CAME * evidence.way_mm
            shows = evidence.seen_share > 0 or evidence.faint_share > _SHOWS or came
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
        told_mm = self.seen_mm + self.came_mm
        counts = self.hidden or told_mm >= least_share * self.visible_mm
        self.unseen = 0 if counts else self.before + 1
        self.unseen_said = min(self.unseen_said, self.unseen)

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
        if told is None or evidence.level_mm is None or evidence.mends:
            return
        any_ink = told.ink_mm > 0
        joined = not any_ink or told.head_mm >= _JOINED_MM
        self.before_tail = self.tail if joined else []
        self.tail = [*([] if any_ink else self.tail), *told.tail]

    def none_yet(self) -> tuple[str, tuple[Gap, ...]]:
        """Say once that no ink was seen so far: none can be known by its look then.

        With the stretches of which nothing tells that ink came.
        """
        if self.first_mm is None or self.first_mm < _FIRST_MM:
            return "", ()
        way_mm, self.first_mm, stretches = self.first_mm, None, tuple(self.tail)
        self.tail = []
        return (
            f"no ink is seen yet where {way_mm:.0f} mm of lines should lie: the needle is clogged, "
            "the syringe empty, or the device can't tell this ink from what lies around it; look "
            "before you go on",
            stretches,
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

    def blind(self) -> tuple[str, tuple[Gap, ...]]:
        """Say once that nothing tells of what was written for long; with those stretches."""
        way_mm = math.fsum(one.length_mm for one in self.tail)
        if self.blind_said or way_mm < _BLIND_MM:
            return "", ()
        stretches = tuple(self.tail)
        self.blind_said, self.tail = True, []
        return (
            f"nothing tells whether ink lies on the last {way_mm:.0f} mm{where(stretches)}: light, "
            "grain or older ink of its own look hides it; look whether it is there (this is said "
            "once)",
            stretches,
        )

    def view_lost(self, layers: int) -> bool:
        """Say that too little was seen of so many layers in a row, and again after as many more."""
        if self.unseen < self.unseen_said + layers:
            return False
        self.unseen_said = self.unseen
        return True

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
