"""Grow a kidney's artery (and vein): from the hilum between lobes, then below the cortex."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from design.anatomy.from_trunks import TrunkPlan
from design.anatomy.grown import AnatomicTrees, grow_fitted, grow_pair, trunk_ends
from design.anatomy.openness import SurfaceSamples, sample_surface
from design.anatomy.trunk_lines import Layer, LayerForest, join_layer, lines_of, spread_sites
from design.errors import GrowthError, TissueError
from design.network import VesselKind
from design.tissue import Demand, Tissue, function_demand
from design.vasculature.growth.parts import check_inlet
from design.vasculature.growth.supply import check_one_part, demand_points
from design.vasculature.options import GrowthOptions
from kernels.arrays import FloatArray

Place = tuple[float, float, float]
_SAMPLES = 12_000
_VOLUME = 30_000
_PLACES = 6_000
_LOBES = 9
_ARC_ROOM = 1.3
"""Depth of the arcs' zone below the capsule, over the cortex's thickness."""
_LEAST_DEPTH = 0.0055
"""Least depth of the trunks over the cube root of the kidney's volume: 0.3 mm in a man's."""
_DEEP = 2.5
"""Cost of leaving the arcs' zone, for branches of the second rank on."""


@dataclass(frozen=True)
class KidneyAnatomy:
    """What a kidney's vessels are told; what isn't is found in its shape.

    Attributes
    ----------
    hilum_mm : (float, float, float), optional
        Near where the vessels enter.
    cortex_mm : float, optional
        Thickness of the cortex; a third of the greatest depth by default.
    cortex_demand : float
        Terminals per volume of the cortex over the medulla's.
    trunk_ends : int
        How many ends the trunks have, at about.
    vein : "none" or "beside"
        Whether a vein runs beside the artery.
    """

    hilum_mm: Place | None = None
    cortex_mm: float | None = None
    cortex_demand: float = 4.0
    trunk_ends: int = 120
    vein: Literal["none", "beside"] = "none"


def grow_kidney(
    tissue: Tissue, options: GrowthOptions, anatomy: KidneyAnatomy | None = None
) -> AnatomicTrees:
    """Grow the artery of any kidney, and the vein beside it where it is asked for.

    Hilum, capsule and cortex are found in the shape (`find_kidney_places`). Trunks enter on the
    sinus's wall, go through the medulla to the border of the cortex and on along it; the wide
    vessels leave the cortex free. From these the tree goes on into cortex and medulla.

    Raises
    ------
    TissueError, GrowthError
        Where no trunk or tree fits.
    """
    anatomy = anatomy or KidneyAnatomy()
    ends = trunk_ends(anatomy.trunk_ends, options.terminals, "kidney")
    check_one_part(tissue)
    samples = sample_surface(tissue, _SAMPLES, options.seed, cavities=False)
    volume, _ = demand_points(tissue, _VOLUME, options.seed)
    check_inlet(tissue, "hilum", anatomy.hilum_mm)
    entry = None if anatomy.hilum_mm is None else np.array(anatomy.hilum_mm)
    places = find_kidney_places(tissue, samples, volume, entry, anatomy.cortex_mm)
    tissue = replace(tissue, demand=_demand(tissue, places, anatomy.cortex_demand))
    least = _LEAST_DEPTH * float(np.cbrt(tissue.volume_mm3))
    layer = kidney_layer(tissue, places, volume, least)
    forest = kidney_forest(layer, places, ends)
    lines = lines_of(forest, {0: places.entry}, volume)
    plan = TrunkPlan(lines, least, exactly=False, keep=places.kept_in_medulla)
    if anatomy.vein == "beside":
        kinds = (VesselKind.ARTERY, VesselKind.VEIN)
        trees = grow_pair(tissue, plan, options)
        return AnatomicTrees(trees, kinds, ("artery", "vein"), _notes(places), tissue.demand)
    trees = grow_fitted(tissue, plan, options)
    artery = (VesselKind.ARTERY,)
    return AnatomicTrees(trees, artery, ("artery",), _notes(places), tissue.demand)


def kidney_layer(
    tissue: Tissue, places: KidneyPlaces, volume: FloatArray, least_mm: float
) -> Layer:
    """Places all over the medulla and the cortex's inner border, ``least_mm`` deep at least."""
    inside = places.below_capsule(volume) >= places.cortex_mm
    points = volume[inside & (-tissue.grid.distance(volume) > least_mm)]
    return join_layer(tissue, points[:_PLACES], 0.67 * least_mm)


def kidney_forest(layer: Layer, places: KidneyPlaces, ends: int) -> LayerForest:
    """One tree: first to some lobes, as straight as can be; then along the cortex's border."""
    depth = places.below_capsule(layer.points)
    arcs = np.flatnonzero(depth <= _ARC_ROOM * places.cortex_mm)
    if len(arcs) < 10:
        raise GrowthError("the cortex leaves no medulla to run trunks in; give a lower cortex_mm")
    # Random places all over a volume have their nearest neighbours 0.554 of its cube root away.
    near = cKDTree(layer.points).query(layer.points, 2)[0][:, 1]
    shell = len(arcs) * (float(near.mean()) / 0.554) ** 3
    area = shell / ((_ARC_ROOM - 1.0) * places.cortex_mm)
    forest = LayerForest(layer, 0.6, layer.length.copy(), 0.3 * float(np.sqrt(area / _LOBES)))
    forest.plant(0, layer.nearest(places.entry + 2.0 * layer.spacing_mm * places.inward))
    lobes = spread_sites(layer.points[arcs], _LOBES, places.entry[None])
    forest.join(arcs[lobes])
    begin = np.repeat(np.arange(len(layer.points)), np.diff(layer.first))
    deep = np.maximum(depth[begin], depth[layer.to]) > _ARC_ROOM * places.cortex_mm
    forest.cost = layer.length * np.where(deep, _DEEP, 1.0)
    forest.balance, forest.apart = 0.3, 0.62 * float(np.sqrt(area / ends))
    taken = layer.points[np.flatnonzero(forest.parent > -2)]
    forest.join(arcs[spread_sites(layer.points[arcs], 3 * ends, taken)])
    return forest


def _demand(tissue: Tissue, places: KidneyPlaces, ratio: float) -> Demand:
    def weight(points: FloatArray) -> FloatArray:
        cortex = places.below_capsule(points) < places.cortex_mm
        demand: FloatArray = np.where(cortex, max(1.0, ratio), max(1.0, 1.0 / ratio))
        return demand

    return function_demand(tissue, weight)


def _notes(places: KidneyPlaces) -> tuple[str, ...]:
    say = "({:.3g}, {:.3g}, {:.3g})"
    return (
        f"the hilum was taken to open towards {say.format(*places.hilum)}; the vessels enter at "
        f"{say.format(*places.entry)} mm",
        f"the cortex is {places.cortex_mm:.3g} mm thick",
    )


# Find a kidney's hilum (vessel entry), capsule and cortex thickness from its shape.

_SINUS = 0.03
"""Share of the surface, the least open of it, that is the sinus at least."""
CORTEX = 1.0 / 3.0
"""Thickness of the cortex over the greatest depth below the capsule, where it isn't given."""


@dataclass(frozen=True)
class KidneyPlaces:
    """Places of a kidney.

    Attributes
    ----------
    entry, inward : (3,) float64
        Where the vessels enter, mm, on the wall of the sinus; and which way, a unit vector.
    hilum : (3,) float64
        Unit vector out of the hilum.
    capsule : (k, 3) float64, mm
        Places of the outer surface.
    cortex_mm : float, mm
    """

    entry: FloatArray
    inward: FloatArray
    hilum: FloatArray
    capsule: FloatArray
    cortex_mm: float

    def below_capsule(self, points: FloatArray) -> FloatArray:
        """Depth (n,) of points (n, 3) below the capsule, the sinus's wall left out of account."""
        depth: FloatArray = cKDTree(self.capsule).query(points)[0]
        return depth

    def kept_in_medulla(self, points: FloatArray) -> FloatArray:
        """Points (n, 3), those in the cortex moved to its inner border."""
        away, near = cKDTree(self.capsule).query(points)
        from_there = points - self.capsule[near]
        short = np.maximum(self.cortex_mm - away, 0.0)
        moved: FloatArray = points + (short / np.maximum(away, 1e-9))[:, None] * from_there
        return moved


def find_kidney_places(
    tissue: Tissue,
    samples: SurfaceSamples,
    volume: FloatArray,
    entry: FloatArray | None = None,
    cortex_mm: float | None = None,
) -> KidneyPlaces:
    """Find the hilum where the surface is least open, and the cortex below all the rest.

    Parameters
    ----------
    volume : (k, 3) float64, mm
        Points all over the tissue.
    entry : (3,) float64, mm, optional
        Near where the vessels enter; else the middle of the sinus.

    Raises
    ------
    TissueError
        Where the surface is as open everywhere, and no entry is given.
    """
    least = float(np.quantile(samples.openness, _SINUS))
    inner = samples.openness <= max(min(0.5, 0.97 * samples.openness.max()), least)
    if inner.mean() > 0.5:
        inner = samples.openness <= least
    if inner.mean() > 0.5:
        if entry is None:
            raise TissueError(
                "no hilum is found: the surface is as open everywhere; give the place where the "
                "vessels enter (anatomy: {inlets: {hilum: {at_mm: [x, y, z]}}})"
            )
        away = np.linalg.norm(samples.points - entry, axis=1)
        inner = away <= np.quantile(away, _SINUS)
    capsule = samples.points[~inner]
    middle = samples.points[inner].mean(axis=0)
    target = middle if entry is None else entry
    inside = np.flatnonzero(inner)
    at = int(inside[np.argmin(np.linalg.norm(samples.points[inside] - target, axis=1))])
    if entry is not None:
        at = int(np.argmin(np.linalg.norm(samples.points - entry, axis=1)))
    out = samples.way_out[inner].sum(axis=0)
    if not np.linalg.norm(out) > 0.0:
        out = -samples.inward[at]  # of a sinus so narrow that no ray leaves it
    depth = cKDTree(capsule).query(volume)[0]
    return KidneyPlaces(
        samples.points[at],
        samples.inward[at],
        out / np.linalg.norm(out),
        capsule,
        cortex_mm if cortex_mm is not None else CORTEX * float(depth.max()),
    )
