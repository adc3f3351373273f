"""Select gaps that are significant in one or two pictures (Bonferroni) at a false-repair rate.

A layer is tested at many places, and each test can err. A gap counts where its p-value, times the
number of places tested in that picture (Bonferroni), is below the rate that a layer may err with.
With a second picture it must be there in both, in the second at `second_rate`, since only the
places that the first picture named are tested again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from registration.layer_images.values import Gap


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
        longest = gap.length_mm + 2.0 * gap.u_mm
        return longest >= self.least_mm and gap.p_value * max(places, 1) <= self.rate


def confirmed_gaps(
    first: Sequence[Gap],
    places: int,
    second: Sequence[Gap] | None,
    test: GapTest,
) -> tuple[Gap, ...]:
    """Return the gaps that count, as the first picture shows them.

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
    return tuple(gap for gap in significant if _seen_again(gap, again))


def _seen_again(gap: Gap, again: Sequence[Gap]) -> bool:
    """Whether the second picture's gaps cover at least half of a gap."""
    return 2 * sum(_overlap_mm(gap, other) for other in again) >= gap.length_mm


def _overlap_mm(one: Gap, other: Gap) -> float:
    """Way that both miss, mm; 0 on different strokes."""
    if one.stroke != other.stroke:
        return 0.0
    return max(min(one.to_mm, other.to_mm) - max(one.from_mm, other.from_mm), 0.0)
