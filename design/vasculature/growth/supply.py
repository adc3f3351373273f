"""Compare the terminals' flow in each part of a tissue with its demand; list unreached regions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from design.errors import DesignError, TissueError
from design.tissue import Part, Tissue, part_demands, part_numbers, parts_of
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
    listed = "; ".join(
        f"{one.volume_mm3:.3g} mm³: {one.terminals} terminals, {100 * one.flow_share:.3g} % of the "
        f"flow for {100 * one.demand_share:.3g} % of the demand"
        for one in supply[:most]
    )
    more = f"; and {len(supply) - most} smaller parts" if len(supply) > most else ""
    notes = [f"The tissue has {len(supply)} separate parts, each with vessels ({listed}{more})."]
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
    listed = ", ".join(str(parts[n]) for n in left[:most])
    more = f" and {len(left) - most} more" if len(left) > most else ""
    return (
        f"the tissue has {len(parts)} separate parts, and vessels that enter one can't reach "
        f"another: no vessel ends in {listed}{more}. {advice}"
    )


def no_way(missed: Sequence[Unreached], most: int = 3) -> str:
    """The message on places that no vessel reaches."""
    listed = ", ".join(map(str, missed[:most]))
    more = f" and {len(missed) - most} more" if len(missed) > most else ""
    return (
        f"vessels don't reach all of the tissue: none ends in {listed}{more}. The way there may be "
        "too narrow for them, or taken by others: ask for thinner vessels or a smaller clearance, "
        "take that place out of the mesh, or give it an inlet of its own (inlets, with grow: tree "
        "and without a template)"
    )


def _off(one: PartSupply) -> float:
    return abs(one.flow_share / one.demand_share - 1.0)


def _place(part: Part) -> tuple[float, float, float]:
    x, y, z = part.middle_mm.tolist()
    return x, y, z


class MissedSettings(NamedTuple):
    """What counts as a place that no terminal is near."""

    far_factor: float = 3.0
    """Distance from the nearest terminal over the typical one, both times the cube root of the
    demand there."""
    typical_percentile: float = 25.0
    """Of the distances, by demand, taken for typical: most of a tissue may be far."""
    min_terminals: float = 6.0
    """Terminals' worth of demand of such a place."""
    min_probes: int = 12
    """Probes in it: in trees of above 50,000 terminals a single one asks for several, and may
    lie in or beside a wide vessel."""
    probes_per_terminal: int = 40
    fewest_probes: int = 4_000
    most_probes: int = 100_000
    """Points that fill the tissue: by the number of terminals, within two limits."""
    seed: int = 5
    """Of these points."""


MISSED = MissedSettings()


@dataclass(frozen=True)
class Unreached:
    """A place that no terminal is near.

    Attributes
    ----------
    volume_mm3 : float
    middle_mm : (float, float, float)
        The point of it that is farthest from any terminal.
    members : (n,) int64
        Its points among the probes.
    """

    volume_mm3: float
    middle_mm: tuple[float, float, float]
    members: NDArray[np.int64]

    def __str__(self) -> str:
        """Size and place, for messages."""
        x, y, z = self.middle_mm
        return f"the {self.volume_mm3:.3g} mm³ around ({x:.4g}, {y:.4g}, {z:.4g}) mm"


@dataclass(frozen=True)
class Probes:
    """Points that fill a tissue evenly.

    Attributes
    ----------
    points : (n, 3) float64, mm
    asks : (n,) float64
        Share of the tissue's demand; their sum is 1.
    reach_mm : float
        Distance within which two points count as neighbours.
    """

    points: FloatArray
    asks: FloatArray
    reach_mm: float


def probes_for(tissue: Tissue, terminals: int) -> Probes:
    """Points that suit so many terminals; same arguments, same points."""
    count = int(
        np.clip(MISSED.probes_per_terminal * terminals, MISSED.fewest_probes, MISSED.most_probes)
    )
    points, weight = demand_points(tissue, count, MISSED.seed)
    reach = 2.5 * float(np.cbrt(tissue.volume_mm3 / count))
    return Probes(points, weight / weight.sum(), reach)


def unreached(
    tissue: Tissue, ends: FloatArray, probes: Probes | None = None
) -> tuple[Unreached, ...]:
    """Connected places far from all terminals that ask for several terminals, largest first.

    A tree covers what its vessels fit into; a lobe behind a neck narrower than they are is left
    out although it hangs together with the rest.

    Parameters
    ----------
    tissue : Tissue
    ends : (n, 3) float64, mm
        Where the terminals end.
    probes : Probes, optional
    """
    if len(ends) < 2 * MISSED.min_terminals:
        return ()
    probes = probes or probes_for(tissue, len(ends))
    asks = probes.asks * len(ends)
    away, _ = KDTree(ends).query(probes.points)
    # Where less is asked for, terminals lie farther apart by the cube root of it.
    away = away * np.cbrt(probes.asks * len(probes.asks))
    order = np.argsort(away)
    below = np.cumsum(probes.asks[order])
    typical = float(away[order][np.searchsorted(below, MISSED.typical_percentile / 100.0)])
    far = np.flatnonzero(away > MISSED.far_factor * typical)
    if asks[far].sum() < MISSED.min_terminals:
        return ()
    pairs = KDTree(probes.points[far]).query_pairs(probes.reach_mm, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(far),) * 2)
    group = connected_components(graph, directed=False)[1]
    places = []
    large = np.bincount(group, weights=asks[far]) >= MISSED.min_terminals
    for n in np.flatnonzero(large & (np.bincount(group) >= MISSED.min_probes)):
        own = far[group == n]
        x, y, z = probes.points[own[np.argmax(away[own])]].tolist()
        volume = tissue.volume_mm3 * len(own) / len(away)
        places.append(Unreached(volume, (x, y, z), own))
    return tuple(sorted(places, key=lambda one: -one.volume_mm3))


# A terminal's territory is the part of the tissue that is nearer to it than to any other terminal
# (its Voronoi cell). Its demand is measured on points that fill the tissue evenly, weighed by
# demand.
POINTS_PER_TERMINAL, MIN_POINTS, MAX_POINTS = 400, 100_000, 4_000_000
"""Points by which territories are measured."""
_DEMAND_SEED = 1 << 40
"""Added to the seed: a later report on supply must not measure it with the points that set it."""
_GOLDEN = 1.2207440846057596
"""Root of x⁴ = x + 1: its inverse powers fill space evenly (Roberts 2018)."""


@dataclass(frozen=True)
class SupplyBalance:
    """Supply over demand of the terminals' territories; 1 is just what each asks for.

    Attributes
    ----------
    terminals : int
    spread : float
        Standard deviation of supply over demand, weighed by demand.
    p5, p95 : float
        Percentiles by demand: so much of the tissue's demand is served worse, or better.
    worst : float
        The least.
    worst_at_mm : (float, float, float)
        Its terminal.
    sampling : float
        Spread that random points of this number would show, were all territories alike; these
        points show less.
    """

    terminals: int
    spread: float
    p5: float
    p95: float
    worst: float
    worst_at_mm: tuple[float, float, float]
    sampling: float


def demand_points(
    tissue: Tissue,
    count: int,
    seed: int,
    owns: Callable[[FloatArray], NDArray[np.bool_]] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """So many points (n, 3) in the tissue, mm, and the demand's weight there (n,).

    Only points that ``owns`` says True of are taken.
    """
    low, high = tissue.bounds
    step = _GOLDEN ** -np.arange(1.0, 4.0)
    at = np.random.default_rng([seed, 0x7E44]).uniform(size=3)
    parts = [np.empty((0, 3))]
    size = 0
    while size < count:
        tried = low + ((at + np.arange(1, count + 1)[:, None] * step) % 1.0) * (high - low)
        at = (at + count * step) % 1.0
        tried = tried[tissue.contains(tried)]
        parts.append(tried if owns is None else tried[owns(tried)])
        size += len(parts[-1])
    points = np.concatenate(parts)[:count]
    return points, tissue.demand.weight(points)


def points_for(terminals: int) -> int:
    """How many points suit so many territories."""
    return int(np.clip(POINTS_PER_TERMINAL * terminals, MIN_POINTS, MAX_POINTS))


def territory_demand(points: FloatArray, weight: FloatArray, tips: FloatArray) -> FloatArray:
    """Each terminal's share of the demand, (k,); their sum is 1.

    Parameters
    ----------
    points, weight : (n, 3), (n,) float64
        As `demand_points` gives them.
    tips : (k, 3) float64, mm
    """
    _, owner = KDTree(tips).query(points)
    share: FloatArray = np.bincount(owner, weights=weight, minlength=len(tips)) / weight.sum()
    return share


def flows_by_demand(
    tissue: Tissue,
    tips: FloatArray,
    terminals: int,
    seed: int,
    owns: Callable[[FloatArray], NDArray[np.bool_]] | None,
) -> FloatArray:
    """Return the flow that each terminal's territory asks for, (k,), over the mean terminal's.

    Parameters
    ----------
    tips : (k, 3) float64, mm
    terminals : int
        By which the number of points is chosen.
    seed : int
    owns : function
        As `demand_points` takes it.
    """
    points, weight = demand_points(tissue, points_for(terminals), seed + _DEMAND_SEED, owns)
    return len(tips) * territory_demand(points, weight, tips)


def supply_balance(
    tissue: Tissue, tips: FloatArray, flow: FloatArray, seed: int = 1
) -> SupplyBalance:
    """Compare terminals' flows with their territories' demand.

    Parameters
    ----------
    tissue : Tissue
    tips : (k, 3) float64, mm
    flow : (k,) float64
        In any unit.
    seed : int
        Of the points.

    Raises
    ------
    DesignError
        When there is no terminal, or no flow.
    """
    if len(tips) == 0 or len(tips) != len(flow) or not float(flow.sum()) > 0.0:
        raise DesignError(
            f"{len(tips)} terminals with {len(flow)} flows can't be compared with the tissue's "
            "demand; give a flow for each"
        )
    points, weight = demand_points(tissue, points_for(len(tips)), seed)
    demand = territory_demand(points, weight, tips)
    # A territory that no point fell into asks for less than half a point.
    seen = np.maximum(demand, 0.5 * float(weight.mean()) / float(weight.sum()))
    ratio = (flow / flow.sum()) / seen
    order = np.argsort(ratio, kind="stable")
    below = np.cumsum(demand[order])
    low, high = (ratio[order][min(np.searchsorted(below, p), len(tips) - 1)] for p in (0.05, 0.95))
    worst = int(order[0])
    return SupplyBalance(
        terminals=len(tips),
        spread=float(np.sqrt((demand * (ratio - 1.0) ** 2).sum())),
        p5=float(low),
        p95=float(high),
        worst=float(ratio[worst]),
        worst_at_mm=(float(tips[worst, 0]), float(tips[worst, 1]), float(tips[worst, 2])),
        sampling=float(np.sqrt(len(tips) / len(points))),
    )
