"""Grow a heart's left and right coronary artery on the epicardium, with branches into the wall."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from design.anatomy.from_trunks import DEPTH_MARGIN, TrunkPlan
from design.anatomy.graph_trunk import LayerForest
from design.anatomy.grown import AnatomicTrees, Trees, grow_fitted
from design.anatomy.heart_base import FEWEST
from design.anatomy.heart_places import HeartPlaces, find_heart_places
from design.anatomy.heart_trunk import (
    LEFT,
    RIGHT,
    guide_depth,
    heart_forest,
    heart_layer,
    narrow_places,
    ostium_above,
)
from design.anatomy.main_branches import (
    line_pieces,
    lost_branch,
    missing_branches,
    trunk_pieces,
)
from design.anatomy.openness import SurfaceSamples, sample_surface
from design.anatomy.perforators import with_perforators
from design.anatomy.published_drop import LAID, trunks_mm, with_published_radii
from design.anatomy.trunk_count import trunk_ends
from design.anatomy.trunk_lines import TrunkLines, lines_of
from design.errors import GrowthError, NoRoomError
from design.network import VesselKind
from design.tissue import Tissue
from design.units import PA_PER_MMHG
from design.vasculature.growth.forest import likely_radius
from design.vasculature.growth.parts import check_inlet
from design.vasculature.growth.supply import check_one_part
from design.vasculature.growth.territories import demand_points
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree

Place = tuple[float, float, float]

_NARROWER: Final = 3
"""Times that the drop is raised at most, where trunks are too wide for the wall."""

_HIGHEST: Final = 7.0
"""Pressure drop that is chosen at most, over the given one; as in `published_match`."""

NAMES: Final = ("left_coronary", "right_coronary")

_SAMPLES = 12_000
_VOLUME = 20_000
_WIDEST: Final = 0.17
"""Radius over the root's at which branches of the epicardium's trunks take on no more terminals
while there are few: they may still widen to a fifth, where a trunk begins. Ours."""
_LEAST_FED: Final = 4
"""Terminals that such a branch may feed however few there are."""


@dataclass(frozen=True)
class HeartAnatomy:
    """What a heart's coronaries are told; what isn't is found in its shape.

    Attributes
    ----------
    base, right : (float, float, float), optional
        Directions from the apex to the base, and from the left ventricle to the right one.
    left_ostium_mm, right_ostium_mm : (float, float, float), optional
        Near where the coronaries begin.
    trunk_ends : int
        How many ends the epicardial vessels have, at about.
    trunk_depth_mm : float, mm
        Least depth of their axes.
    balance : float
        See `LayerForest`.
    published_radii : bool
        Change the pressure drop as little as brings all orders' diameters, lengths and ratios
        within the published spread (Kassab et al. 1993), as far as one drop can.
    """

    base: Place | None = None
    right: Place | None = None
    left_ostium_mm: Place | None = None
    right_ostium_mm: Place | None = None
    trunk_ends: int = 600
    trunk_depth_mm: float = 0.3
    balance: float = 0.5
    published_radii: bool = False


def grow_heart(
    tissue: Tissue, options: GrowthOptions, anatomy: HeartAnatomy | None = None
) -> AnatomicTrees:
    """Grow left and right coronary in any heart's ventricles.

    Base, right side and grooves are found in the shape (`find_heart_places`). The trunks run
    below the epicardium: left main, anterior descending and circumflex; right with its posterior
    descending; and side branches all over it. From these the tree goes on into the wall.

    Raises
    ------
    TissueError, GrowthError
        Where no layer, ostium or tree fits.
    """
    anatomy = anatomy or HeartAnatomy()
    free = anatomy.published_radii and options.smallest_radius_mm is None
    highest = _HIGHEST * options.pressure_drop_pa
    narrower, before = options, None
    for left in range(_NARROWER, -1, -1):
        try:
            made = _grow(tissue, narrower, anatomy)
            break
        except NoRoomError as error:
            drop = narrower.pressure_drop_pa * error.drop_factor
            if not (free and left and drop <= highest and error.nearer_than(before)):
                raised = narrower.pressure_drop_pa / options.pressure_drop_pa
                told = "" if narrower is options else f" ({_mmhg(narrower)} mmHg were tried last)"
                raise error.around(after=told).beyond(raised) from error
            narrower, before = replace(narrower, pressure_drop_pa=drop), error
    return replace(made, notes=(*made.notes, *_drop_note(made.trees[0], options, narrower)))


def _mmhg(options: GrowthOptions) -> str:
    return f"{options.pressure_drop_pa / PA_PER_MMHG:.3g}"


def _grow(tissue: Tissue, options: GrowthOptions, anatomy: HeartAnatomy) -> AnatomicTrees:
    """The coronaries with the options' pressure drop, or another nearer to published radii."""
    ends = trunk_ends(anatomy.trunk_ends, options.terminals, "heart")
    check_one_part(tissue)
    samples = sample_surface(tissue, _SAMPLES, options.seed)
    places = find_heart_places(samples, _vector(anatomy.base), _vector(anatomy.right))
    depth = guide_depth(tissue, samples, places, anatomy.trunk_depth_mm)
    layer = heart_layer(tissue, samples, places, depth)
    given = {LEFT: anatomy.left_ostium_mm, RIGHT: anatomy.right_ostium_mm}
    for tree, place in given.items():
        check_inlet(tissue, NAMES[tree], place)
    near = {tree: np.array(place) for tree, place in given.items() if place is not None}
    wide = DEPTH_MARGIN * likely_radius(tissue, options) + options.clearance_mm
    narrow = narrow_places(tissue, layer, wide)
    forest, branches = heart_forest(layer, places, ends, anatomy.balance, near, narrow)
    begins = {tree: _begin(forest, tree, given) for tree in given}
    ostia = {t: ostium_above(tissue, layer.points[i], places.base) for t, i in begins.items()}
    volume, _ = demand_points(tissue, _VOLUME, options.seed)
    plan = TrunkPlan(
        lines_of(forest, ostia, volume),
        anatomy.trunk_depth_mm,
        branches=lambda lines, radius: with_perforators(tissue, lines, radius, volume, options),
        branches_are_trunks=False,
        widest_branch=_widest_branch(options),
        main=frozenset(place.tobytes() for one in branches for place in one.line),
        lost=lambda lines, radius: lost_branch(branches, line_pieces(lines, radius)),
    )
    trees = grow_fitted(tissue, plan, options)
    lost = lost_branch(branches, trunk_pieces(trees))
    if lost is not None:
        raise lost
    if anatomy.published_radii:
        trees = with_published_radii(trees, tissue, plan, options, branches, volume)
    notes = (
        *_notes(samples, places, ostia),
        *_left_out_note(plan.lines, trees),
        *missing_branches(branches, trunk_pieces(trees)),
    )
    return AnatomicTrees(trees, (VesselKind.ARTERY,) * 2, NAMES, notes)


def _widest_branch(options: GrowthOptions) -> float:
    """See `_WIDEST`; by Murray's law, where each coronary has half of the terminals."""
    part = 2.0 * _LEAST_FED / options.terminals
    return float(max(_WIDEST, part ** (1.0 / options.murray_exponent)))


def _drop_note(
    tree: VesselTree, options: GrowthOptions, narrower: GrowthOptions
) -> tuple[str, ...]:
    """What is said of a pressure drop that was changed for thin walls or for published radii."""
    ours, before = tree.pressure_drop_pa, options.pressure_drop_pa
    if abs(ours / before - 1.0) < 1e-9:
        return ()
    why = "with it diameters and lengths are nearest to those of Kassab et al. 1993"
    if ours < before:
        why += "; where its wider trunks leave tissue without vessels, give a drop yourself"
    if ours >= narrower.pressure_drop_pa > before:
        why = "wider trunks don't fit in the wall"
    return (
        f"pressure_drop_mmhg was taken as {ours / PA_PER_MMHG:.3g} instead of "
        f"{before / PA_PER_MMHG:.3g}: {why}",
    )


def _left_out_note(lines: TrunkLines, trees: Trees) -> tuple[str, ...]:
    """What is said of trunks' branches that don't fit."""
    planned, laid = _planned_mm(lines), trunks_mm(trees)
    if laid > LAID * planned:
        return ()
    return (
        f"trunks are {laid:.0f} mm long, {planned:.0f} mm were planned: branches that didn't fit "
        "were left out; a higher pressure_drop_mmhg or fewer trunk_ends leave them room",
    )


def _planned_mm(lines: TrunkLines) -> float:
    ends = np.flatnonzero(lines.parent >= 0)
    pieces = lines.points[ends] - lines.points[lines.parent[ends]]
    return float(np.linalg.norm(pieces, axis=1).sum())


def _begin(forest: LayerForest, tree: int, given: dict[int, Place | None]) -> int:
    """Number of the place in the layer where a coronary begins."""
    places = np.flatnonzero((forest.parent == -1) & (forest.tree == tree))
    if len(places) == 0:
        given_text = ", ".join(
            f"{NAMES[one]} near {place}" for one, place in given.items() if place
        )
        raise GrowthError(
            f"{NAMES[tree]} finds no place of its own to begin (given: {given_text or 'none'}); "
            "give left_coronary and right_coronary places further apart"
        )
    return int(places[0])


def _vector(place: Place | None) -> np.ndarray[tuple[int], np.dtype[np.float64]] | None:
    return None if place is None else np.array(place, dtype=np.float64)


def _notes(
    samples: SurfaceSamples, places: HeartPlaces, ostia: dict[int, np.ndarray]
) -> tuple[str, ...]:
    say = "({:.3g}, {:.3g}, {:.3g})"
    hollow = (~samples.outer).mean() >= FEWEST
    guess = (
        "no cavity opens in this shape, so that it may not be a heart's: base and right side are "
        "guesses from its outline; give base_direction and right_direction",
    )
    return (
        *(() if hollow else guess),
        f"the heart's base was taken to lie towards {say.format(*places.base)}, its right side "
        f"towards {say.format(*places.right)}",
        *places.doubts,
        "ostia: "
        + ", ".join(f"{name} at {say.format(*ostia[tree])} mm" for tree, name in enumerate(NAMES)),
    )
