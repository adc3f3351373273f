"""Grow a liver's portal vein and hepatic artery side by side, and hepatic veins between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.anatomy.from_trunks import TrunkPlan
from design.anatomy.graph_trunk import LayerForest, spread_sites
from design.anatomy.grown import AnatomicTrees, grow_portal
from design.anatomy.layer import Layer, join_layer
from design.anatomy.liver_places import LiverPlaces, find_liver_places
from design.anatomy.openness import sample_surface
from design.anatomy.trunk_count import trunk_ends
from design.anatomy.trunk_lines import TrunkLines, lines_of
from design.network import VesselKind
from design.tissue import Tissue
from design.vasculature.growth.parts import check_inlet
from design.vasculature.growth.supply import check_one_part
from design.vasculature.growth.territories import demand_points
from design.vasculature.options import GrowthOptions
from kernels.arrays import FloatArray

Place = tuple[float, float, float]

NAMES: Final = ("portal_vein", "hepatic_artery", "hepatic_veins")

SEGMENTS = 8
"""Branches of the portal vein that come first, as many as Couinaud's segments (1957)."""

VEINS = 3
"""Hepatic veins that come first: right, middle and left."""

_SAMPLES = 12_000
_VOLUME = 30_000
_PLACES = 6_000
_DEPTH = 0.03
"""Least depth of the trunks over the cube root of the liver's volume. Ours."""

_APART = 0.6
"""Way from the portal trunks, over its greatest, from which on hepatic trunks cost nothing more."""


@dataclass(frozen=True)
class LiverAnatomy:
    """What a liver's vessels are told; what isn't is found in its shape.

    Attributes
    ----------
    porta_mm, cava_mm : (float, float, float), optional
        Near where portal vein and artery enter, and the hepatic veins leave.
    trunk_ends : int
        How many ends the portal vein's trunks have, at about; the hepatic veins' have as many.
    """

    porta_mm: Place | None = None
    cava_mm: Place | None = None
    trunk_ends: int = 100


def grow_liver(
    tissue: Tissue, options: GrowthOptions, anatomy: LiverAnatomy | None = None
) -> AnatomicTrees:
    """Grow portal vein, hepatic artery and hepatic veins of any liver, as many terminals each.

    The portal vein enters at the porta hepatis, with the artery beside it down to the terminals.
    The hepatic veins gather from between its branches, and leave to the vena cava.

    Raises
    ------
    TissueError, GrowthError
        Where no trunk or tree fits.
    """
    anatomy = anatomy or LiverAnatomy()
    ends = trunk_ends(anatomy.trunk_ends, options.terminals, "liver")
    check_inlet(tissue, "porta_hepatis", anatomy.porta_mm)
    check_inlet(tissue, "vena_cava", anatomy.cava_mm)
    check_one_part(tissue)
    samples = sample_surface(tissue, _SAMPLES, options.seed, cavities=False)
    volume, _ = demand_points(tissue, _VOLUME, options.seed)
    given = (None if at is None else np.array(at) for at in (anatomy.porta_mm, anatomy.cava_mm))
    places = find_liver_places(samples, tissue.volume_mm3, *given)
    deep = _DEPTH * float(np.cbrt(tissue.volume_mm3))
    layer = liver_layer(tissue, volume, deep)
    portal = portal_forest(layer, places, ends)
    hepatic = hepatic_forest(layer, places, portal, ends)
    lines = _together(
        lines_of(portal, {0: places.porta}, volume), lines_of(hepatic, {0: places.cava}, volume)
    )
    trees = grow_portal(tissue, TrunkPlan(lines, 0.3 * deep, exactly=False), options)
    kinds = (VesselKind.ARTERY, VesselKind.ARTERY, VesselKind.VEIN)
    return AnatomicTrees(trees, kinds, NAMES, _notes(places))


def liver_layer(tissue: Tissue, volume: FloatArray, depth_mm: float) -> Layer:
    """Places all over the liver, but for what lies just below its surface."""
    points = volume[-tissue.grid.distance(volume) > depth_mm]
    return join_layer(tissue, points[:_PLACES], 0.6 * depth_mm)


def portal_forest(layer: Layer, places: LiverPlaces, ends: int) -> LayerForest:
    """One tree from the porta: to the segments first, as straight as can be; then all over."""
    forest = LayerForest(layer, 0.5, layer.length.copy(), 0.3 * _between(layer, SEGMENTS))
    forest.plant(0, layer.nearest(places.porta + 2.0 * layer.spacing_mm * places.porta_inward))
    forest.join(spread_sites(layer.points, SEGMENTS, places.porta[None]))
    forest.balance, forest.apart = 0.3, 0.62 * _between(layer, ends)
    _fill(forest, ends)
    return forest


def hepatic_forest(
    layer: Layer, places: LiverPlaces, portal: LayerForest, ends: int
) -> LayerForest:
    """One tree from the vena cava, its trunks far from those of the portal vein."""
    taken = layer.points[portal.parent > -2]
    away = cKDTree(taken).query(layer.points)[0]
    free = np.clip(away / (_APART * away.max()), 0.1, 1.0)
    begin = np.repeat(np.arange(len(layer.points)), np.diff(layer.first))
    cost = layer.length * 2.0 / (free[begin] + free[layer.to])
    forest = LayerForest(layer, 0.5, cost, 0.3 * _between(layer, VEINS))
    forest.plant(0, layer.nearest(places.cava + 2.0 * layer.spacing_mm * places.cava_inward))
    between = np.flatnonzero(away >= np.median(away))
    forest.join(between[spread_sites(layer.points[between], VEINS, places.cava[None])])
    forest.balance, forest.apart = 0.3, 0.62 * _between(layer, ends)
    _fill(forest, ends, between)
    return forest


def _between(layer: Layer, count: int) -> float:
    """Distance of places at which so many are spread over the layer's volume, mm."""
    near = cKDTree(layer.points).query(layer.points, 2)[0][:, 1]
    # Random places have their nearest neighbours 0.554 of their volume's cube root away.
    return float((len(layer.points) / count) ** (1 / 3) * near.mean() / 0.554)


def _fill(forest: LayerForest, ends: int, among: NDArray[np.int64] | None = None) -> None:
    """Join places spread over the layer, or ``among`` some, to the trees as they stand."""
    points = forest.layer.points
    among = np.arange(len(points)) if among is None else among
    taken = points[np.flatnonzero(forest.parent > -2)]
    forest.join(among[spread_sites(points[among], 2 * ends, taken)])


def _together(one: TrunkLines, two: TrunkLines) -> TrunkLines:
    """Lines of two trees as one, numbered 0 and 1, each with its own shares."""
    first = len(one.parent)
    return TrunkLines(
        np.concatenate([one.points, two.points]),
        np.concatenate([one.parent, np.where(two.parent >= 0, two.parent + first, -1)]),
        np.concatenate([np.zeros(first, dtype=np.int64), np.ones(len(two.parent), dtype=np.int64)]),
        np.concatenate([one.share, two.share]),
    )


def _notes(places: LiverPlaces) -> tuple[str, ...]:
    say = "({:.3g}, {:.3g}, {:.3g})"
    return (
        f"the diaphragm was taken to lie towards {say.format(*places.up)}; portal vein and artery "
        f"enter at {say.format(*places.porta)} mm, the hepatic veins leave at "
        f"{say.format(*places.cava)} mm",
        "portal vein and hepatic artery both stand as arteries in the network: blood flows in",
    )
