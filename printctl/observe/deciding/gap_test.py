"""Select gaps that are significant in one or two pictures (Bonferroni) at a false-repair rate.

A layer is tested at many places, and each test can err. A gap counts where its p-value, times the
number of places tested in that picture (Bonferroni), is below the rate that a layer may err with.
With a second picture it must be there in both, in the second at `second_rate`, since only the
places that the first picture named are tested again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from registration.inspection.values import Gap


@dataclass(frozen=True)
class GapTest:
    """Rates at which gaps are believed.

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
        """Whether a gap is long enough (its ends are unsure), and believed among ``places``."""
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
    return tuple(part for gap in significant for part in _in_both(gap, again, test.least_mm))


def _in_both(gap: Gap, again: Sequence[Gap], least_mm: float) -> list[Gap]:
    """A gap of which the second picture's cover half at least; else what both show of it.

    That are gaps of the second picture which lie by half at least in this one.
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
    """Way that both miss, mm; 0 on different strokes."""
    if one.stroke != other.stroke:
        return 0.0
    return max(min(one.to_mm, other.to_mm) - max(one.from_mm, other.from_mm), 0.0)
