"""Decisions and their tolerances; test of gaps at a false-repair rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Literal

from printctl.inspection.values import Gap
from printctl.observe.deciding.evidence import ThinStretch
from printctl.observe.deciding.flow_control import FlowLimits


@dataclass(frozen=True)
class GapTest:
    """Significance test of gaps: least length and false rates.

    A layer is tested at many places, and each test can err. A gap counts where its p-value, times
    the number of places tested in that picture (Bonferroni), is below the rate that a layer may err
    with. With a second picture it must be there in both, in the second at `second_rate`, since only
    the places that the first picture named are tested again.

    Attributes
    ----------
    least_mm : float, mm
        Shorter gaps are within tolerance.
    rate : float
        False gaps per sound layer, by the first picture: 0.001 are five in 5,000 layers.
    second_rate : float
        Chance that the second picture repeats a false gap of the first by noise.
    """

    least_mm: float = 0.2
    rate: float = 1e-3
    second_rate: float = 0.01

    def significant(self, gap: Gap, places: int) -> bool:
        """Return whether a gap is long enough, given unsure ends, and significant."""
        longest = gap.length_mm + 2.0 * gap.u_tip_mm
        return longest >= self.least_mm and gap.p_value * max(places, 1) <= self.rate


def confirmed_gaps(
    first: Sequence[Gap],
    places: int,
    second: Sequence[Gap] | None,
    test: GapTest,
) -> tuple[Gap, ...]:
    """Return the gaps that count, as the first picture shows them.

    Of one that the second picture shows less than half of, the parts that it shows.

    Parameters
    ----------
    first : sequence of Gap
    places : int
        Places tested in the first picture.
    second : sequence of Gap or None
        Of another picture of the same; None where there is none, and the first alone decides.
    test : GapTest
    """
    significant = [gap for gap in first if test.significant(gap, places)]
    if second is None:
        return tuple(significant)
    retested = max(len(significant), 1)
    again = [gap for gap in second if gap.p_value * retested <= test.second_rate]
    return tuple(part for gap in significant for part in _common_parts(gap, again, test.least_mm))


def _common_parts(gap: Gap, again: Sequence[Gap], least_mm: float) -> list[Gap]:
    """Return a gap if the second picture's cover half of it; else the parts that both show.

    Parts are gaps of the second picture of which half or more lies in this one.
    """
    if 2 * sum(_overlap_mm(gap, other) for other in again) >= gap.length_mm:
        return [gap]
    parts = []
    for other in again:
        both = _overlap_mm(gap, other)
        if both >= least_mm and 2 * both >= other.length_mm:
            begin = max((gap, other), key=lambda one: one.from_mm)
            end = min((gap, other), key=lambda one: one.to_mm)
            part = replace(gap, from_mm=begin.from_mm, start_mm=begin.start_mm)
            parts.append(replace(part, to_mm=end.to_mm, end_mm=end.end_mm))
    return parts


def _overlap_mm(one: Gap, other: Gap) -> float:
    """Return the length that two gaps share, mm; 0 on different strokes."""
    if one.stroke != other.stroke:
        return 0.0
    return max(min(one.to_mm, other.to_mm) - max(one.from_mm, other.from_mm), 0.0)


Mode = Literal["tell", "ask", "mend"]


class DecisionKind(StrEnum):
    """Action after a look."""

    GO_ON = "go_on"
    FLOW = "flow"
    MEND = "mend"
    PAUSE = "pause"
    STOP = "stop"


@dataclass(frozen=True)
class Costs:
    """Costs of faults and actions, in minutes of an operator; the cheapest action is taken.

    Attributes
    ----------
    operator : float
        Being asked once.
    false_ink_mm : float
        A millimetre of ink on sound ink.
    missed_ink_mm : float
        A millimetre of missing ink that is left so.
    scrapped : float
        A print that is lost.
    """

    operator: float = 10.0
    false_ink_mm: float = 20.0
    missed_ink_mm: float = 5.0
    scrapped: float = 600.0


@dataclass(frozen=True)
class Limits:
    """Tolerances, costs, and the mode that says what needs approval.

    Attributes
    ----------
    gap : GapTest
    flow : FlowLimits
    width_percent : float
        Tolerated deviation of a line's width.
    lumen_percent : float
        By which a lumen may be seen narrower.
    shift_mm : float, mm
        By which a layer may lie beside its place.
    unseen_mm : float, mm
        Stretch of a vessel in a bath that needn't be seen: a longer one is worth an operator's
        look.
    least_seen : float
        Share of the way that must be seen for a look to count.
    mend : "tell", "ask" or "mend"
    costs : Costs
    """

    gap: GapTest = field(default_factory=GapTest)
    flow: FlowLimits = field(default_factory=FlowLimits)
    width_percent: float = 15.0
    lumen_percent: float = 10.0
    shift_mm: float = 0.1
    unseen_mm: float = 1.5
    least_seen: float = 0.5
    mend: Mode = "ask"
    costs: Costs = field(default_factory=Costs)

    @property
    def least_open(self) -> float:
        """Share of a lumen's width that must be open."""
        return 1.0 - self.lumen_percent / 100.0


@dataclass(frozen=True)
class Decision:
    """Decision after a look.

    Attributes
    ----------
    kind : DecisionKind
        What is done now.
    why : str
        For operator and journal.
    gaps : tuple of Gap
        To be mended; only reported where the print goes on.
    thin : tuple of ThinStretch
        To be filled up.
    factor : float or None
        Flow factor from here on.
    ask : DecisionKind or None
        Action that the operator is to approve while the print waits; None for none.
    """

    kind: DecisionKind
    why: str
    gaps: tuple[Gap, ...] = ()
    factor: float | None = None
    ask: DecisionKind | None = None
    thin: tuple[ThinStretch, ...] = ()
