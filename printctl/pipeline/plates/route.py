"""Find the shortest printing order of wells, row by row or column by column (serpentine)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import dist

from printctl.pipeline.plates.place import StandingPlate

Plan = tuple[float, list[str]]


def route(wells: Sequence[str], standing: StandingPlate) -> list[str]:
    """The shortest way row by row, or column by column if that is shorter.

    Each lane is gone through in the direction that makes the whole way shortest: over a whole
    block a serpentine.

    Parameters
    ----------
    wells : sequence of str
    standing : StandingPlate
    """
    plans = [_by_lanes(wells, standing, _row, _column), _by_lanes(wells, standing, _column, _row)]
    return min(plans, key=_rank)[1]


def _rank(plan: Plan) -> tuple[float, list[str]]:
    """Shorter ones first; of equals always the same."""
    return round(plan[0], 6), plan[1]


def _row(well: str) -> int:
    return ord(well[0])


def _column(well: str) -> int:
    return int(well[1:])


def _by_lanes(
    wells: Sequence[str],
    standing: StandingPlate,
    lane_of: Callable[[str], int],
    along: Callable[[str], int],
) -> Plan:
    """The shortest way lane by lane, (length in mm, wells).

    Of all ways through the lanes so far only two matter to the next one: the shortest that ends at
    either end of the last lane.
    """
    ways: list[Plan] = [(0.0, [])]
    for lane in sorted({lane_of(well) for well in wells}):
        inside = sorted((well for well in wells if lane_of(well) == lane), key=along)
        ways = [
            min((_joined(way, turn, standing) for way in ways), key=_rank)
            for turn in (inside, inside[::-1])
        ]
    return min(ways, key=_rank)


def _joined(way: Plan, lane: list[str], standing: StandingPlate) -> Plan:
    length, before = way
    places = [standing.centre_mm(well) for well in [*before[-1:], *lane]]
    length += sum(dist(a, b) for a, b in pairwise(places))
    return length, [*before, *lane]
