"""Organ templates: survey a shape, grow trees from planned trunks until they fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor, log10
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from design.anatomy.fit import fit_trees, with_flows
from design.anatomy.fitting.goal import Clearance, Goal
from design.anatomy.from_trunks import LAYING, TrunkPlan, grow_from_plan
from design.anatomy.main_branches import check_main_branches, trunk_pieces
from design.anatomy.openness import SurfaceSamples, sample_surface
from design.anatomy.trunk_lines import spread_sites
from design.errors import (
    LEAST_IN_CORTEX,
    LEAST_TERMINALS,
    CrowdedError,
    GrowthError,
    NoRoomError,
    WideTrunkError,
)
from design.network import VesselKind
from design.tissue import Tissue
from design.tissue.tissue import Demand
from design.units import PA_PER_MMHG
from design.vasculature.growth.parts import check_inlet
from design.vasculature.growth.supply import check_one_part, demand_points
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from kernels.arrays import BoolArray, FloatArray

Trees = tuple[VesselTree, ...]
Place = tuple[float, float, float]


class Template(NamedTuple):
    """Growth by a template."""

    murray_exponent: float
    pressure_drop_mmhg: float  # from the inlet to the terminals; sets how slender vessels are
    cavities: bool = False  # whether walls of closed cavities guide vessels; a cyst must not
    volume_places: int = 30_000  # all over the tissue, by which trunks' shares are measured
    least_terminals: int = LEAST_TERMINALS  # as many for each of six trunk ends
    surface_places: int = 12_000


PRESETS: Final = {
    # Between Murray's 3 and the 7/3 that Huo and Kassab find in coronary casts (PMC4913552). With
    # 7.3 mmHg elements are as slender as those of Kassab et al. 1993 (measures/published/).
    "heart": Template(2.5, 7.3, True, 20_000),
    # Nordsletten et al. 2006 find Murray's law. The drop is ours: no figure was confirmed.
    "kidney": Template(3.0, 20.0),
    # Of the portal vein, to its terminals. Ours: no figure of these was confirmed.
    "liver": Template(3.0, 5.0),
    # Helthuis et al. 2019 (Anat Rec 302:1434, PMC6767475) find Murray's law in human cerebral
    # arteries of 0.1 to 1 mm radius. The drop is ours.
    "cortex": Template(3.0, 20.0, True, 20_000, LEAST_IN_CORTEX),
}
LAYER_PLACES: Final = 6_000
"""Of a volume, between which trunks run."""


@dataclass(frozen=True)
class Survey:
    """Places of a tissue by which an organ's trunks are planned."""

    tissue: Tissue
    samples: SurfaceSamples
    volume: FloatArray  # (n, 3), mm, all over the tissue
    ends: int  # of the trunks
    given: dict[str, FloatArray]  # places (3,), mm, of inlets that are given

    def places(self, inside: BoolArray | bool, depth_mm: float) -> FloatArray:
        """Return places (k, 3) of the volume deeper than ``depth_mm``, where ``inside`` (n,)."""
        deep = -self.tissue.grid.distance(self.volume) > depth_mm
        return self.volume[inside & deep][:LAYER_PLACES]


def survey(
    organ: str,
    tissue: Tissue,
    options: GrowthOptions,
    ends: int,
    given: dict[str, Place | None],
) -> Survey:
    """Sample an organ's surface and volume, once the request is checked.

    Raises
    ------
    GrowthError
        For fewer terminals or ends than the template needs.
    TissueError
        For a tissue of several parts, or an inlet far from it.
    """
    template = PRESETS[organ]
    ends = trunk_ends(ends, options.terminals, organ, template.least_terminals)
    check_one_part(tissue)
    for name, place in given.items():
        check_inlet(tissue, name, place)
    samples = sample_surface(tissue, template.surface_places, options.seed, template.cavities)
    volume, _ = demand_points(tissue, template.volume_places, options.seed)
    near = {name: np.array(place) for name, place in given.items() if place is not None}
    return Survey(tissue, samples, volume, ends, near)


def say(vector: FloatArray) -> str:
    """Return a place or direction (3,) as notes say it."""
    return "({:.3g}, {:.3g}, {:.3g})".format(*vector)


def trunk_ends(wanted: int, terminals: int, organ: str, least: int = LEAST_TERMINALS) -> int:
    """Return the number of trunk ends: as wanted, or what the terminals are enough for.

    Raises
    ------
    GrowthError
        For fewer than ``least`` terminals, or than six ends.
    """
    ends = 6
    for count, fewest, what in (
        (terminals, least, "terminals"),
        (wanted, ends, "trunk_ends"),
    ):
        if count < fewest:
            raise GrowthError(
                f"{what} is {count}; the template of a {organ} needs {fewest} at least"
            )
    return min(wanted, terminals * ends // least)


class _Search(NamedTuple):
    """What is tried where vessels don't fit, and what is tried before it is advised."""

    spare: float = 1.08  # terminals to grow over those wanted: where vessels don't fit some go
    spare_beside: float = 1.2  # the same where vessels lie side by side
    attempts: int = 5  # growths, with more terminals to spare or more room between trunks
    more_room: float = 0.15  # between trunks, each time
    most_spare: float = 1.4  # terminals that are grown over the first time's
    least_spare: float = 0.01  # more of them with each attempt, though few didn't fit
    nearly: float = 0.95  # of the terminals, from which on trunks don't need more room
    clearer: float = 1.15  # clearance to grow with over that kept once vessels are curved
    clearer_ratio: float = 1.3
    fewer: tuple[float, ...] = (1.0, 0.7)  # of the terminals that fit: others have other trunks
    narrower: tuple[float, ...] = (1.0, 4.0, 8.0)  # on the pressure drop, at least, each time
    nearer: tuple[float, ...] = (0.5, 0.2)  # of the clearance, where narrower vessels don't help


SEARCH = _Search()


@dataclass(frozen=True)
class AnatomicTrees:
    """Trees of an organ.

    Attributes
    ----------
    trees : tuple of VesselTree
        With bends (segments of one child).
    kinds, names : tuple of VesselKind, tuple of str
        Of each tree; of its inlet.
    notes : tuple of str
        What was found in the shape, and chosen.
    demand : Demand, optional
        By which the terminals were spread, where it isn't the tissue's own.
    """

    trees: tuple[VesselTree, ...]
    kinds: tuple[VesselKind, ...]
    names: tuple[str, ...]
    notes: tuple[str, ...]
    demand: Demand | None = None


def grow_trees(
    tissue: Tissue,
    plan: TrunkPlan,
    options: GrowthOptions,
    tubes: Sequence[GrowthOptions] = (),
    lay: Callable[[Trees], Trees] = lambda trees: trees,
) -> Trees:
    """Grow trees from a plan's trunks and fit them; the first growth that fits is taken.

    Where terminals were too few, more are grown to spare; where they were far too few, or trunks
    didn't fit, trunks get more room each time.

    Parameters
    ----------
    options : GrowthOptions
        Of each tree, or of all together where several share the tissue.
    tubes, lay : sequence of GrowthOptions, function of trees to trees, optional
        Of each tree, where vessels are laid along them; and what lays these.

    Raises
    ------
    TissueError, GrowthError
        As `grow_from_plan` and `fit_trees`, after some attempts.
    """
    spare = SEARCH.spare_beside if tubes else SEARCH.spare
    grown = tuple(_with_spare(one, spare) for one in tubes or (options,))
    shared = len(grown) < len(np.unique(plan.lines.tree))
    clearance = Clearance(options.clearance_mm, options.clearance_ratio)
    goal = Goal(clearance, options.terminals, shared, plan.rises_to_mm)
    error = GrowthError("not tried")
    best: CrowdedError | None = None
    room, more = 0, 1.0
    for attempt in range(SEARCH.attempts):
        each = tuple(replace(one, terminals=ceil(more * one.terminals)) for one in grown)
        wider = replace(plan, wider=LAYING.wider * (1.0 + SEARCH.more_room * room))
        try:
            trees = grow_from_plan(tissue, wider, each)
        except GrowthError as failed:
            if best is not None:
                error = failed
                break
            raise _unplanned(failed, options, each[0]) from failed
        try:
            trees = fit_trees(tissue, lay(with_flows(trees, goal)), goal)
        except CrowdedError as failed:
            best, error = max((best or failed, failed), key=lambda one: one.fit), failed
            room += failed.fit < SEARCH.nearly * failed.asked
            # As many again as didn't fit.
            lacking = best.asked / max(1, best.fit) + SEARCH.least_spare * (attempt + 1)
            more = min(SEARCH.most_spare, lacking)
        except GrowthError as failed:
            if best is None and isinstance(failed, WideTrunkError):
                raise  # neither room nor terminals to spare help
            error = failed
            room += 1
        else:
            check_main_branches(plan.main, trunk_pieces(trees))
            return trees
    raise _given_up(error, best) from error


def _given_up(error: GrowthError, best: CrowdedError | None) -> GrowthError:
    """Return the error of the attempt in which most terminals fitted, or of the last."""
    if best is not None:
        return CrowdedError(best.fit, best.asked, f" (best of {SEARCH.attempts} attempts)")
    return _no_room(error).around(after=f" (last of {SEARCH.attempts} attempts)")


def _with_spare(options: GrowthOptions, spare: float) -> GrowthOptions:
    """Return options with more terminals and clearance than curved vessels keep."""
    return replace(
        options,
        terminals=ceil(spare * options.terminals) + 8,
        clearance_mm=SEARCH.clearer * options.clearance_mm,
        clearance_ratio=SEARCH.clearer_ratio * options.clearance_ratio,
    )


def _unplanned(error: GrowthError, asked: GrowthOptions, grown: GrowthOptions) -> NoRoomError:
    """Return what is raised where no trees grow from the trunks."""
    if isinstance(error, WideTrunkError):
        return error
    return _no_room(error).around(
        after=f". For the {asked.terminals} terminals asked for, {asked.clearance_mm:g} mm "
        f"apart, {grown.terminals} are grown {grown.clearance_mm:.3g} mm apart: "
        "curves and vessels side by side need the room"
    )


def _no_room(error: GrowthError) -> NoRoomError:
    """Return what a growth was refused for: whatever it is, narrower vessels may fit."""
    return error if isinstance(error, NoRoomError) else NoRoomError(str(error))


Grow = Callable[[GrowthOptions], AnatomicTrees]


def grow_or_advise(
    grow: Grow, options: GrowthOptions, least: int, tried: Grow | None = None
) -> AnatomicTrees:
    """Return what ``grow`` makes of the options.

    Parameters
    ----------
    least : int
        Terminals that the template takes at least.
    tried : function of options, optional
        A shorter ``grow`` that succeeds only where that would; ``grow`` itself by default.

    Raises
    ------
    CrowdedError
        Naming a smaller number only where that was grown.
    NoRoomError
        Naming a higher pressure drop, or a smaller diameter, only where that was grown.
    TissueError, GrowthError
        As ``grow``.
    """
    try:
        return grow(options)
    except CrowdedError as crowded:
        raise _with_fewer(crowded, tried or grow, options, least) from crowded
    except NoRoomError as narrow:
        raise _with_narrower(narrow, tried or grow, options) from narrow


def _with_fewer(
    crowded: CrowdedError, grow: Grow, options: GrowthOptions, least: int
) -> CrowdedError:
    """Return the error, with what came of fewer terminals, then of narrower vessels."""
    counts: list[int] = []
    for part in SEARCH.fewer:
        if int(part * crowded.fit) < least:
            break
        counts.append(int(part * crowded.fit))
        if _refusal(grow, replace(options, terminals=counts[-1])) is None:
            return crowded.with_fewer(counts, least, grown=True)
    narrower = options
    for factor in SEARCH.narrower[1:]:
        narrower, remedy = _narrower(narrower, factor)
        if _refusal(grow, narrower) is None:
            return crowded.with_fewer(counts, least, narrower=remedy)
    return crowded.with_fewer(counts, least)


def _with_narrower(narrow: NoRoomError, grow: Grow, options: GrowthOptions) -> NoRoomError:
    """Return the error with what came of narrower vessels and then of less room."""
    way = "less" if options.smallest_radius_mm else "more (radii fall by its fourth root)"
    failed, narrower = narrow, options
    tried: list[str] = []
    for factor in SEARCH.narrower:
        narrower, remedy = _narrower(narrower, max(factor, failed.drop_factor))
        tried.append(remedy)
        error = _refusal(grow, narrower)
        if error is None:
            return narrow.with_remedy(f"give a {remedy} or {way}, which was tried and fits")
        if not error.nearer_than(failed):
            break
        failed = error
    for part in SEARCH.nearer:
        clearance = _rounded(part * options.clearance_mm, floor)
        tried.append(f"clearance_mm of {clearance:g}")
        if _refusal(grow, replace(options, clearance_mm=clearance)) is None:
            return narrow.with_remedy(f"give a {tried[-1]} or less, which was tried and fits")
    return narrow.with_remedy(
        f"neither narrower vessels nor less room between them fit ({', '.join(tried)} were "
        "tried): take fewer terminals or a larger tissue"
    )


def _narrower(options: GrowthOptions, drop_factor: float) -> tuple[GrowthOptions, str]:
    """Return options with narrower vessels, and the recipe's key and value for them."""
    if options.smallest_radius_mm is not None:
        diameter = _rounded(2.0 * options.smallest_radius_mm * drop_factor**-0.25, floor)
        narrower = replace(options, smallest_radius_mm=diameter / 2)
        return narrower, f"smallest_diameter_mm of {diameter:g}"
    drop = _rounded(options.pressure_drop_pa / PA_PER_MMHG * drop_factor, ceil)
    narrower = replace(options, pressure_drop_pa=drop * PA_PER_MMHG)
    return narrower, f"pressure_drop_mmhg of {drop:g}"


def _rounded(value: float, towards: Callable[[float], int]) -> float:
    """Return to two digits; 0 stays."""
    if value <= 0.0:
        return 0.0
    step = 10.0 ** (floor(log10(value)) - 1)
    # What is round already stays, whatever its last bit.
    return float(f"{towards(round(value / step, 6)) * step:.3g}")


def _refusal(grow: Grow, options: GrowthOptions) -> NoRoomError | None:
    """Return why it doesn't grow; None where it does."""
    try:
        grow(options)
    except GrowthError as error:
        return _no_room(error)
    return None


class _Regions(NamedTuple):
    """Regions of an organ whose terminals are counted."""

    points: int = 12_000  # by which their demand is measured
    most: int = 24
    terminals: int = 40  # that each has at least on average
    few: float = 0.5  # of its share, below which a region is named


REGIONS = _Regions()


def uneven_notes(tissue: Tissue, ends: FloatArray, seed: int = 1) -> tuple[str, ...]:
    """Return a sentence on the place that gets least, where it gets under half of its share.

    Parameters
    ----------
    ends : (n, 3) float64, mm
        Where the terminals end.
    """
    places = min(REGIONS.most, len(ends) // REGIONS.terminals)
    if places < 2:
        return ()
    points, weight = demand_points(tissue, REGIONS.points, seed)
    # By their nearest place, moved to the middle once: parts of about the same size.
    middle = points[spread_sites(points, places, points[:0])]
    number = cKDTree(middle).query(points)[1]
    middle = np.array([points[number == n].mean(axis=0) for n in range(places)])
    index = cKDTree(middle)
    asked = np.bincount(index.query(points)[1], weight, places) / weight.sum() * len(ends)
    got = np.bincount(index.query(ends)[1], minlength=places)
    worst = int(np.argmin(got / asked))
    if got[worst] >= REGIONS.few * asked[worst]:
        return ()
    x, y, z = middle[worst].tolist()
    return (
        f"the tissue around ({x:.3g}, {y:.3g}, {z:.3g}) mm gets {got[worst]} terminals where its "
        f"volume asks for {asked[worst]:.0f}: trunks are far from it; more trunk_ends or a higher "
        "pressure_drop_mmhg may help",
    )
