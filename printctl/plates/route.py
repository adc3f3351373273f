"""In which order wells are printed: row by row, or column by column, there and back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import dist

from printctl.plates.place import StandingPlate


def route(wells: Sequence[str], standing: StandingPlate) -> list[str]:
    """The shorter of two serpentines through the wells, along rows or along columns.

    Parameters
    ----------
    wells : sequence of str
    standing : StandingPlate
    """
    plans = [_serpentine(wells, _row, _column), _serpentine(wells, _column, _row)]
    return min(plans, key=lambda plan: _length(plan, standing))


def _row(well: str) -> int:
    return ord(well[0])


def _column(well: str) -> int:
    return int(well[1:])


def _serpentine(
    wells: Sequence[str], lane_of: Callable[[str], int], along: Callable[[str], int]
) -> list[str]:
    found: list[str] = []
    for number, lane in enumerate(sorted({lane_of(well) for well in wells})):
        inside = [well for well in wells if lane_of(well) == lane]
        found += sorted(inside, key=along, reverse=number % 2 == 1)
    return found


def _length(wells: Sequence[str], standing: StandingPlate) -> float:
    return sum(dist(standing.centre_mm(a), standing.centre_mm(b)) for a, b in pairwise(wells))
