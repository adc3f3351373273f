"""Grow an organ's vessel trees from planned trunks; retry until enough terminals fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil, floor, log10
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from design.anatomy.fit_apart import SPARE, SPARE_APART, fitted_apart, fitted_trees, with_flow
from design.anatomy.from_trunks import WIDER, TrunkPlan, grow_from_plan
from design.anatomy.openness import SurfaceSamples, sample_surface
from design.anatomy.side_by_side import Companion, side_by_side, tube_options
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
ATTEMPTS = 5
"""Growths with more room between trunks, where too many vessels don't fit."""
_MORE_ROOM = 0.15
_MOST_SPARE = 1.4
_LEAST_SPARE = 0.01
"""More terminals to spare with each attempt, of those asked for, though few didn't fit."""
_NEARLY = 0.95
"""Of the terminals asked for, from which on trunks don't need more room."""
_CLEARER, _CLEARER_RATIO = 1.15, 1.3
"""Clearance to grow with, over that kept once vessels are curved."""


@dataclass(frozen=True)
class AnatomicTrees:
    """Trees of an organ.

    Attributes
    ----------
    trees : tuple of VesselTree
        With bends (segments of one child).
    kinds : tuple of VesselKind
    names : tuple of str
        Of their inlets.
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


def grow_fitted(tissue: Tissue, plan: TrunkPlan, options: GrowthOptions) -> Trees:
    """Grow trees from a plan's trunks, curve them and keep what fits: so many terminals in all.

    Raises
    ------
    TissueError, GrowthError
        As `grow_from_plan` and `fitted_trees`, after some attempts.
    """
    mm, ratio = options.clearance_mm, options.clearance_ratio

    def fitted(trees: Trees) -> Trees:
        shallow = plan.shallow_mm if plan.exactly else None
        return fitted_trees(tissue, trees, mm, ratio, options.terminals, shallow_mm=shallow)

    return _attempts(tissue, plan, _with_spare(options, SPARE), fitted, options)


def grow_apart(tissue: Tissue, plan: TrunkPlan, options: GrowthOptions) -> Trees:
    """Grow one tree from a plan's trunk; its vessels are pushed apart rather than sunk.

    Raises
    ------
    TissueError, GrowthError
        As `grow_fitted`.
    """
    return _grow_apart(tissue, plan, options, _with_spare(options, SPARE), lambda trees: trees)


def _grow_apart(
    tissue: Tissue,
    plan: TrunkPlan,
    options: GrowthOptions,
    grown: GrowthOptions,
    lay: Callable[[Trees], Trees],
) -> Trees:
    """Grow trees with the options ``grown``, ``lay`` vessels along them and push these apart."""
    mm, ratio, terminals = options.clearance_mm, options.clearance_ratio, options.terminals

    def fitted(trees: Trees) -> Trees:
        # The terminals to spare go in the end: the others get their flow.
        flowing = tuple(with_flow(tree, float(tree.flow_ul_s[0]) / terminals) for tree in trees)
        return fitted_apart(tissue, lay(flowing), mm, ratio, terminals)

    return _attempts(tissue, plan, grown, fitted, options)


def grow_pair(tissue: Tissue, plan: TrunkPlan, options: GrowthOptions) -> Trees:
    """Grow an artery and a vein beside it from a plan's trunks, with so many terminals each.

    Raises
    ------
    TissueError, GrowthError
        As `grow_fitted`.
    """
    tubes = _with_spare(tube_options(options), SPARE_APART)
    return _grow_apart(tissue, plan, options, tubes, lambda made: side_by_side(made[0], options))


PORTAL_SHARE = 0.75
"""Of the liver's blood, that of the portal vein; the artery has the rest (Eipel et al. 2010,
doi 10.3748/wjg.v16.i48.6046: 75 to 80 %)."""
HEPATIC_ARTERY = Companion(drop=4.0, flow=1.0 / PORTAL_SHARE - 1.0, tube=1.48)
"""Beside the portal vein, then 0.54 times as wide. Four times its pressure drop is ours."""
HEPATIC_DROP = 0.5
"""Pressure drop along the hepatic veins over the portal vein's. Ours."""


def grow_portal(tissue: Tissue, plan: TrunkPlan, options: GrowthOptions) -> Trees:
    """Grow portal vein, artery beside it and hepatic veins from a plan's two trunks.

    Parameters
    ----------
    options : GrowthOptions
        Of the portal vein, but for the flow, which is the liver's.

    Raises
    ------
    TissueError, GrowthError
        As `grow_fitted`.
    """
    portal = replace(
        options, perfusion_ml_min_per_ml=PORTAL_SHARE * options.perfusion_ml_min_per_ml
    )
    hepatic = replace(options, pressure_drop_pa=HEPATIC_DROP * options.pressure_drop_pa)
    each = tuple(
        _with_spare(one, SPARE_APART) for one in (tube_options(portal, HEPATIC_ARTERY), hepatic)
    )

    def lay(trees: Trees) -> Trees:
        return (*side_by_side(trees[0], portal, HEPATIC_ARTERY), trees[1])

    return _grow_apart(tissue, replace(plan, each=each), options, each[0], lay)


def _with_spare(options: GrowthOptions, spare: float) -> GrowthOptions:
    """Options of growth: more terminals and clearance than are kept once vessels are curved."""
    return replace(
        options,
        terminals=ceil(spare * options.terminals) + 8,
        clearance_mm=_CLEARER * options.clearance_mm,
        clearance_ratio=_CLEARER_RATIO * options.clearance_ratio,
    )


def _attempts(
    tissue: Tissue,
    plan: TrunkPlan,
    options: GrowthOptions,
    fitted: Callable[[Trees], Trees],
    asked: GrowthOptions,
) -> Trees:
    """What ``fitted`` makes of the first growth that it doesn't refuse.

    Where terminals were too few, more are grown to spare; where they were far too few, or trunks
    didn't fit, trunks get more room each time.
    """
    error = GrowthError("not tried")
    best: CrowdedError | None = None
    room = 0
    for attempt in range(ATTEMPTS):
        wider = WIDER * (1.0 + _MORE_ROOM * room)
        # As many again as didn't fit last time.
        lacking = best.asked / max(1, best.fit) + _LEAST_SPARE * attempt if best else 1.0
        spare = min(_MOST_SPARE, lacking)
        each = tuple(_more(one, spare) for one in plan.each)
        settings = _more(options, spare)
        try:
            trees, _ = grow_from_plan(tissue, replace(plan, wider=wider, each=each), settings)
        except GrowthError as failed:
            if best is not None:
                error = failed
                break
            if isinstance(failed, WideTrunkError):
                raise
            raise _no_room(failed).around(
                after=f". For the {asked.terminals} terminals asked for, {asked.clearance_mm:g} mm "
                f"apart, {settings.terminals} are grown {settings.clearance_mm:.3g} mm apart: "
                "curves and vessels side by side need the room"
            ) from failed
        try:
            return fitted(trees)
        except CrowdedError as failed:
            best, error = max((best or failed, failed), key=lambda one: one.fit), failed
            room += failed.fit < _NEARLY * failed.asked
        except GrowthError as failed:
            if best is None and isinstance(failed, WideTrunkError):
                raise  # neither room nor terminals to spare help
            error = failed
            room += 1
    if best is not None:
        raise CrowdedError(best.fit, best.asked, f" (best of {ATTEMPTS} attempts)") from error
    raise _no_room(error).around(after=f" (last of {ATTEMPTS} attempts)") from error


def _no_room(error: GrowthError) -> NoRoomError:
    """What a growth was refused for: whatever it is, narrower vessels may fit."""
    return error if isinstance(error, NoRoomError) else NoRoomError(str(error))


def _more(options: GrowthOptions, spare: float) -> GrowthOptions:
    return replace(options, terminals=ceil(spare * options.terminals))


# Grow an organ's trees; where they don't fit, try fewer or narrower vessels before advising so.

_TRIED: Final = (1.0, 0.7)
"""Of the terminals that fit; fewer terminals have other trunks, and mayn't fit either."""
_NARROWER: Final = (1.0, 4.0, 8.0)
"""Least factors on the pressure drop, each over the one before, of the narrower vessels tried."""
_NEARER: Final = (0.5, 0.2)
"""Parts of the clearance that are tried where narrower vessels don't help."""


def grow_or_advise(
    grow: Callable[[GrowthOptions], AnatomicTrees],
    options: GrowthOptions,
    least: int,
    tried: Callable[[GrowthOptions], AnatomicTrees] | None = None,
) -> AnatomicTrees:
    """Return what ``grow`` makes of the options.

    Parameters
    ----------
    grow : function of options
    options : GrowthOptions
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
    crowded: CrowdedError,
    grow: Callable[[GrowthOptions], AnatomicTrees],
    options: GrowthOptions,
    least: int,
) -> CrowdedError:
    """The error, with what came of fewer terminals."""
    counts: list[int] = []
    for part in _TRIED:
        fewer = int(part * crowded.fit)
        if fewer < least:
            break
        counts.append(fewer)
        if _fits(grow, replace(options, terminals=fewer)) is None:
            return crowded.with_fewer(counts, least, grown=True)
    narrower = options
    for factor in _NARROWER[1:]:
        narrower, value = _narrower(narrower, factor)
        if _fits(grow, narrower) is None:
            return crowded.with_fewer(counts, least, narrower=f"{_key(options)} of {value}")
    return crowded.with_fewer(counts, least)


def _with_narrower(
    narrow: NoRoomError, grow: Callable[[GrowthOptions], AnatomicTrees], options: GrowthOptions
) -> NoRoomError:
    """The error, with what came of narrower vessels and, where they don't help, of less room."""
    key = _key(options)
    way = "less" if options.smallest_radius_mm else "more (radii fall by its fourth root)"
    failed, narrower = narrow, options
    values: list[str] = []
    for least in _NARROWER:
        narrower, value = _narrower(narrower, max(least, failed.drop_factor))
        values.append(value)
        error = _fits(grow, narrower)
        if error is None:
            return narrow.with_remedy(f"give a {key} of {value} or {way}, which was tried and fits")
        if not error.nearer_than(failed):
            break
        failed = error
    tried = f"{key} of {' and '.join(values)}"
    for part in _NEARER:
        clearance = _rounded(part * options.clearance_mm, floor)
        tried += f", clearance_mm of {clearance:g}"
        if _fits(grow, replace(options, clearance_mm=clearance)) is None:
            return narrow.with_remedy(
                f"give a clearance_mm of {clearance:g} or less, which was tried and fits"
            )
    return narrow.with_remedy(
        f"neither narrower vessels nor less room between them fit ({tried} were tried): take fewer "
        "terminals or a larger tissue"
    )


def _key(options: GrowthOptions) -> str:
    """Which key of a recipe makes vessels narrower."""
    return "smallest_diameter_mm" if options.smallest_radius_mm else "pressure_drop_mmhg"


def _narrower(options: GrowthOptions, drop_factor: float) -> tuple[GrowthOptions, str]:
    """The options with narrower vessels, and the value that a recipe gives for it."""
    if options.smallest_radius_mm is not None:
        diameter = _rounded(2.0 * options.smallest_radius_mm * drop_factor**-0.25, floor)
        narrower = replace(options, smallest_radius_mm=diameter / 2)
        return narrower, f"{diameter:g}"
    drop = _rounded(options.pressure_drop_pa / PA_PER_MMHG * drop_factor, ceil)
    narrower = replace(options, pressure_drop_pa=drop * PA_PER_MMHG)
    return narrower, f"{drop:g}"


def _rounded(value: float, towards: Callable[[float], int]) -> float:
    """To two digits; 0 stays."""
    if value <= 0.0:
        return 0.0
    step = 10.0 ** (floor(log10(value)) - 1)
    # What is round already stays, whatever its last bit.
    return float(f"{towards(round(value / step, 6)) * step:.3g}")


def _fits(
    grow: Callable[[GrowthOptions], AnatomicTrees], options: GrowthOptions
) -> NoRoomError | None:
    """None where it grows, else why not."""
    try:
        grow(options)
    except NoRoomError as error:
        return error
    except GrowthError as error:
        return NoRoomError(str(error))
    return None


# Warn of the region of an organ that has under half of the terminals its volume calls for.

_POINTS = 12_000
_PLACES, _TERMINALS = 24, 40
"""Places compared at most, and terminals that each has at least on average."""
_FEW = 0.5


def uneven_notes(tissue: Tissue, ends: FloatArray, seed: int = 1) -> tuple[str, ...]:
    """A sentence on the place that gets least, where it gets under half of its share.

    Parameters
    ----------
    ends : (n, 3) float64, mm
        Where the terminals end.
    """
    places = min(_PLACES, len(ends) // _TERMINALS)
    if places < 2:
        return ()
    points, weight = demand_points(tissue, _POINTS, seed)
    # By their nearest place, moved to the middle once: parts of about the same size.
    middle = points[spread_sites(points, places, points[:0])]
    number = cKDTree(middle).query(points)[1]
    middle = np.array([points[number == n].mean(axis=0) for n in range(places)])
    index = cKDTree(middle)
    asked = np.bincount(index.query(points)[1], weight, places) / weight.sum() * len(ends)
    got = np.bincount(index.query(ends)[1], minlength=places)
    worst = int(np.argmin(got / asked))
    if got[worst] >= _FEW * asked[worst]:
        return ()
    x, y, z = middle[worst].tolist()
    return (
        f"the tissue around ({x:.3g}, {y:.3g}, {z:.3g}) mm gets {got[worst]} terminals where its "
        f"volume asks for {asked[worst]:.0f}: trunks are far from it; more trunk_ends or a higher "
        "pressure_drop_mmhg may help",
    )


# Templates of organs: what is known before the shape is.


@dataclass(frozen=True)
class Template:
    """Growth by a template.

    Attributes
    ----------
    murray_exponent : float
    pressure_drop_mmhg : float
        From the inlet to the terminals; sets how slender vessels are.
    cavities : bool
        Whether walls of closed cavities may guide vessels; a kidney's cyst must not.
    volume_places : int
        Places all over the tissue by which shares of trunks are measured.
    least_terminals : int
        As many for each of six trunk ends.
    """

    murray_exponent: float
    pressure_drop_mmhg: float
    cavities: bool = False
    volume_places: int = 30_000
    least_terminals: int = LEAST_TERMINALS


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
_SURFACE_PLACES: Final = 12_000
_LAYER_PLACES: Final = 6_000
_LEAST_ENDS: Final = 6


@dataclass(frozen=True)
class Survey:
    """Places of a tissue by which an organ's trunks are planned.

    Attributes
    ----------
    tissue : Tissue
    samples : SurfaceSamples
    volume : (n, 3) float64, mm
        All over the tissue.
    ends : int
        Of the trunks.
    given : of each inlet's name, (3,) float64, mm
        Places that are given.
    """

    tissue: Tissue
    samples: SurfaceSamples
    volume: FloatArray
    ends: int
    given: dict[str, FloatArray]

    def places(self, inside: BoolArray | bool, depth_mm: float) -> FloatArray:
        """Return places (k, 3) of the volume deeper than ``depth_mm``, where ``inside`` (n,)."""
        deep = -self.tissue.grid.distance(self.volume) > depth_mm
        return self.volume[inside & deep][:_LAYER_PLACES]


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
    samples = sample_surface(tissue, _SURFACE_PLACES, options.seed, template.cavities)
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
        For fewer than ``least`` terminals, or too few ends.
    """
    for count, fewest, what in (
        (terminals, least, "terminals"),
        (wanted, _LEAST_ENDS, "trunk_ends"),
    ):
        if count < fewest:
            raise GrowthError(
                f"{count} {what} are too few for the template of a {organ}; "
                f"ask for {fewest} at least"
            )
    return min(wanted, terminals * _LEAST_ENDS // least)
