"""Compare the terminals' flow in each part of a tissue with its demand; list unreached regions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.errors import TissueError
from design.tissue import Part, Tissue, part_demands, part_numbers, parts_of
from design.vasculature.growth.unreached import Unreached, unreached
from kernels.arrays import FloatArray

UNEVEN = 0.1
"""How far a part's flow over its demand may be from 1 before a note says so."""

_BY_TREE = (
    "With grow: tree and no template write inlets: each_part under vasculature, or give each part "
    "an inlet; else make a recipe of its own for each part, or take the part out of the mesh"
)
_BY_TEMPLATE = (
    "A template serves one part: make a recipe of its own for each (keep_within under tissue takes "
    "a part), take the part out of the mesh, or leave anatomy out and write inlets: each_part"
)


@dataclass(frozen=True)
class PartSupply:
    """What a part of the tissue asks for and gets.

    Attributes
    ----------
    volume_mm3 : float
    middle_mm : (float, float, float)
        Of its bounds.
    demand_share : float
        Of the tissue's demand; of its volume, where demand is uniform.
    terminals : int
        That end in it.
    flow_share : float
        Of the flow, with all inlets at one pressure and all outlets at another.
    """

    volume_mm3: float
    middle_mm: tuple[float, float, float]
    demand_share: float
    terminals: int
    flow_share: float


def check_supply(
    tissue: Tissue, ends: FloatArray, flow: FloatArray
) -> tuple[tuple[PartSupply, ...], tuple[str, ...]]:
    """Supply of each part, the largest first, and notes on what is uneven or not reached.

    Parameters
    ----------
    tissue : Tissue
    ends : (n, 3) float64, mm
        Where the terminals end.
    flow : (n,) float64
        Of each, in any unit.

    Raises
    ------
    TissueError
        As `check_parts`.
    """
    parts, demand, number = check_parts(tissue, ends)
    within = number >= 0
    count = np.bincount(number[within], minlength=len(parts))
    got = np.bincount(number[within], weights=flow[within], minlength=len(parts)) / flow.sum()
    supply = tuple(
        PartSupply(part.volume_mm3, _place(part), float(demand[n]), int(count[n]), float(got[n]))
        for n, part in enumerate(parts)
    )
    missed = unreached(tissue, ends)
    return supply, (*supply_notes(supply), *((no_way(missed),) if missed else ()))


def check_parts(
    tissue: Tissue, ends: FloatArray
) -> tuple[tuple[Part, ...], FloatArray, NDArray[np.int64]]:
    """Parts of a tissue, their shares of the demand, and in which each of ``ends`` (n, 3) lies.

    Raises
    ------
    TissueError
        Where a part in which perfusion is wanted has none of them; by size and place.
    """
    parts = parts_of(tissue)
    demand = part_demands(tissue, parts)
    number = part_numbers(tissue, parts, ends)
    left = np.setdiff1d(np.flatnonzero(demand > 0), number).tolist()
    if left and len(parts) > 1:
        raise TissueError(no_inlet(parts, left))
    return parts, demand, number


def supply_notes(supply: Sequence[PartSupply], most: int = 4) -> tuple[str, ...]:
    """Sentences for the report on a tissue of several parts; none for one part."""
    if len(supply) == 1:
        return ()
    said = "; ".join(
        f"{one.volume_mm3:.3g} mm³: {one.terminals} terminals, {100 * one.flow_share:.3g} % of the "
        f"flow for {100 * one.demand_share:.3g} % of the demand"
        for one in supply[:most]
    )
    more = f"; and {len(supply) - most} smaller parts" if len(supply) > most else ""
    notes = [f"The tissue has {len(supply)} separate parts, each with vessels ({said}{more})."]
    uneven = [one for one in supply if one.demand_share > 0 and _off(one) > UNEVEN]
    if uneven:
        worst = max(uneven, key=_off)
        x, y, z = worst.middle_mm
        notes.append(
            f"With all inlets at one pressure {len(uneven)} parts get a flow that differs by more "
            f"than {UNEVEN:.0%} from what they ask for; most the part around ({x:.4g}, {y:.4g}, "
            f"{z:.4g}) mm, {worst.flow_share / worst.demand_share:.3g} times as much. Feed each "
            "inlet with its own flow, or fix no smallest_diameter_mm."
        )
    return tuple(notes)


def check_one_part(tissue: Tissue) -> None:
    """Refuse a tissue of which a template's vessels would supply one part alone.

    Raises
    ------
    TissueError
        Where perfusion is wanted in several parts; by size and place.
    """
    parts = parts_of(tissue)
    asking = np.flatnonzero(part_demands(tissue, parts) > 0).tolist()
    if len(asking) > 1:
        raise TissueError(no_inlet(parts, asking[1:], advice=_BY_TEMPLATE))


def no_inlet(
    parts: Sequence[Part], left: Sequence[int], most: int = 3, advice: str = _BY_TREE
) -> str:
    """The message on parts that no inlet leads to."""
    said = ", ".join(str(parts[n]) for n in left[:most])
    more = f" and {len(left) - most} more" if len(left) > most else ""
    return (
        f"the tissue has {len(parts)} separate parts, and vessels that enter one can't reach "
        f"another: no vessel ends in {said}{more}. {advice}"
    )


def no_way(missed: Sequence[Unreached], most: int = 3) -> str:
    """The message on places that no vessel reaches."""
    said = ", ".join(map(str, missed[:most]))
    more = f" and {len(missed) - most} more" if len(missed) > most else ""
    return (
        f"vessels don't reach all of the tissue: none ends in {said}{more}. The way there may be "
        "too narrow for them, or taken by others: ask for thinner vessels or a smaller clearance, "
        "take that place out of the mesh, or give it an inlet of its own (inlets, with grow: tree "
        "and without a template)"
    )


def _off(one: PartSupply) -> float:
    return abs(one.flow_share / one.demand_share - 1.0)


def _place(part: Part) -> tuple[float, float, float]:
    x, y, z = part.middle_mm.tolist()
    return x, y, z
