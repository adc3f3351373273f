"""Grow a liver's portal vein and hepatic artery side by side, and hepatic veins between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.anatomy.from_trunks import TrunkPlan
from design.anatomy.grown import AnatomicTrees, grow_portal, trunk_ends
from design.anatomy.openness import SurfaceSamples, sample_surface
from design.anatomy.trunk_lines import (
    Layer,
    LayerForest,
    TrunkLines,
    join_layer,
    lines_of,
    spread_sites,
)
from design.errors import TissueError
from design.network import VesselKind
from design.tissue import Tissue
from design.vasculature.growth.parts import check_inlet
from design.vasculature.growth.supply import check_one_part, demand_points
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


# Find a liver's porta hepatis (vessel entry) and hepatic vein exit from surface samples.

_PORTA = 0.03
"""Share of the surface, the least open of it, in whose middle the porta hepatis lies."""
_GROOVES = 0.15
"""Share of the surface, the least open of it, that all grooves have; the vena cava's is one."""
_CONVEX = 0.95
"""Openness above which a place lies in no groove."""
_NEAREST, _FARTHEST = 0.35, 1.0
"""Way from the porta to the vena cava over the cube root of the liver's volume."""
_TOP = 0.04
"""Share of the grooves, the highest of them, whose middle is where the hepatic veins leave."""


@dataclass(frozen=True)
class LiverPlaces:
    """Places of a liver.

    Attributes
    ----------
    porta, porta_inward : (3,) float64
        Where portal vein and hepatic artery enter, mm; and which way, a unit vector.
    cava, cava_inward : (3,) float64
        Where the hepatic veins leave to the vena cava, and the way into the liver there.
    up : (3,) float64
        Unit vector from the visceral side to the diaphragm.
    """

    porta: FloatArray
    porta_inward: FloatArray
    cava: FloatArray
    cava_inward: FloatArray
    up: FloatArray


def find_liver_places(
    samples: SurfaceSamples,
    volume_mm3: float,
    porta: FloatArray | None = None,
    cava: FloatArray | None = None,
) -> LiverPlaces:
    """Find the porta in the middle of the visceral side's hollow, the veins' exit above it.

    The hollow is where the surface is least open, and what it opens to is below. Of all grooves
    that aren't at the porta, the vena cava's reaches highest. In the one liver that was at hand
    with its vessels, both places lay within 14 mm of the true ones.

    Parameters
    ----------
    volume_mm3 : float
        Of the liver.
    porta, cava : (3,) float64, mm, optional
        Near where these are, in place of what the shape tells.

    Raises
    ------
    TissueError
        Where the surface is as open everywhere, or has no groove above the porta.
    """
    openness, points = samples.openness, samples.points
    hollow = openness <= np.quantile(openness, _PORTA)
    if hollow.mean() > 0.5 and (porta is None or cava is None):
        raise TissueError(
            "no porta hepatis is found: the surface is as open everywhere; give both places "
            "(anatomy: {inlets: {porta_hepatis: {at_mm: [x, y, z]}, vena_cava: ...}})"
        )
    inside = np.flatnonzero(hollow)
    if porta is None:
        at = int(inside[_nearest(points[inside], points[inside].mean(axis=0))])
    else:
        at = _nearest(points, porta)
    out = samples.way_out[hollow].sum(axis=0)
    up = -out / max(float(np.linalg.norm(out)), 1e-12)
    leaves = _highest_groove(samples, volume_mm3, points[at], up) if cava is None else cava
    veins = _nearest(points, leaves)
    return LiverPlaces(points[at], samples.inward[at], points[veins], samples.inward[veins], up)


def _highest_groove(
    samples: SurfaceSamples, volume_mm3: float, porta: FloatArray, up: FloatArray
) -> FloatArray:
    """Middle (3,) of the highest part of the grooves, the porta's left out."""
    size = float(np.cbrt(volume_mm3))
    away = np.linalg.norm(samples.points - porta, axis=1)
    groove = samples.openness <= min(_CONVEX, float(np.quantile(samples.openness, _GROOVES)))
    groove &= (away > _NEAREST * size) & (away < _FARTHEST * size)
    members = np.flatnonzero(groove)
    if not len(members):
        raise TissueError(
            "no groove of the vena cava is found; give the place where the hepatic veins leave "
            "(anatomy: {inlets: {vena_cava: {at_mm: [x, y, z]}}})"
        )
    height = (samples.points[members] - porta) @ up
    top = members[np.argsort(-height, kind="stable")[: max(1, int(_TOP * len(members)))]]
    middle: FloatArray = samples.points[top].mean(axis=0)
    return middle


def _nearest(points: FloatArray, place: FloatArray) -> int:
    return int(np.argmin(np.linalg.norm(points - place, axis=1)))
