"""Grow a kidney's artery (and vein): from the hilum between lobes, then below the cortex."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from design.anatomy.from_trunks import TrunkPlan
from design.anatomy.organ import AnatomicTrees, Place, Survey, grow_trees, say, survey
from design.anatomy.side_by_side import side_by_side, tube_options
from design.anatomy.trunk_lines import (
    LayerForest,
    Rank,
    TrunkLines,
    Zone,
    join_layer,
    lines_of,
    nearest,
)
from design.errors import GrowthError, TissueError
from design.network import VesselKind
from design.tissue import Demand, Tissue, function_demand
from design.vasculature.options import GrowthOptions
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class KidneyAnatomy:
    """Options of a kidney's vessels; what isn't given is found in its shape.

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


class _Trunks(NamedTuple):
    """How a kidney's trunks are laid."""

    lobes: Rank = Rank(balance=0.6, spacing=0.3, ends=9)  # as straight as can be
    arcs: Rank = Rank(balance=0.3, offered=3)  # along the cortex's inner border
    zone: float = 1.3  # depth of the arcs below the capsule over the cortex's thickness
    leaving: float = 2.5  # cost for arcs of leaving that zone
    least_depth: float = 0.0055  # over the cube root of the volume: 0.3 mm in a man's kidney


TRUNKS = _Trunks()


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
    given = {"hilum": anatomy.hilum_mm}
    shape = survey("kidney", tissue, options, anatomy.trunk_ends, given)
    places = find_kidney_places(shape, anatomy.cortex_mm)
    tissue = replace(tissue, demand=_demand(tissue, places, anatomy.cortex_demand))
    least = TRUNKS.least_depth * float(np.cbrt(tissue.volume_mm3))
    plan = TrunkPlan(
        _trunk_lines(shape, places, least), least, exactly=False, keep=places.kept_in_medulla
    )
    notes = (
        f"the hilum was taken to open towards {say(places.hilum)}; the vessels enter at "
        f"{say(places.entry)} mm",
        f"the cortex is {places.cortex_mm:.3g} mm thick",
    )
    if anatomy.vein == "none":
        trees = grow_trees(tissue, plan, options)
        return AnatomicTrees(trees, (VesselKind.ARTERY,), ("artery",), notes, tissue.demand)
    tubes = (tube_options(options),)
    trees = grow_trees(tissue, plan, options, tubes, lambda made: side_by_side(made[0], options))
    kinds = (VesselKind.ARTERY, VesselKind.VEIN)
    return AnatomicTrees(trees, kinds, ("artery", "vein"), notes, tissue.demand)


def _trunk_lines(shape: Survey, places: KidneyPlaces, least_mm: float) -> TrunkLines:
    """Lay one tree in medulla and the cortex's inner border: first to lobes, then along it."""
    inside = places.below_capsule(shape.volume) >= places.cortex_mm
    layer = join_layer(shape.tissue, shape.places(inside, least_mm), 0.67 * least_mm)
    depth, deepest = places.below_capsule(layer.points), TRUNKS.zone * places.cortex_mm
    border = np.flatnonzero(depth <= deepest)
    if len(border) < 10:
        raise GrowthError("the cortex leaves no medulla to run trunks in; give a lower cortex_mm")
    volume = Zone.of(layer, 3).size * len(border) / len(layer.points)
    zone = Zone(volume / (deepest - places.cortex_mm), 2)
    forest = LayerForest(layer)
    forest.plant(0, layer.below(places.entry, places.inward))
    forest.grow(TRUNKS.lobes, shape.ends, zone, border, far_from=places.entry[None])
    leaves = np.maximum(depth[layer.begin], depth[layer.to]) > deepest
    cost = layer.length * np.where(leaves, TRUNKS.leaving, 1.0)
    forest.grow(TRUNKS.arcs, shape.ends, zone, border, cost)
    return lines_of(forest, {0: places.entry}, shape.volume)


def _demand(tissue: Tissue, places: KidneyPlaces, ratio: float) -> Demand:
    def weight(points: FloatArray) -> FloatArray:
        cortex = places.below_capsule(points) < places.cortex_mm
        demand: FloatArray = np.where(cortex, max(1.0, ratio), max(1.0, 1.0 / ratio))
        return demand

    return function_demand(tissue, weight)


SINUS = 0.03
"""Share of the surface, the least open of it, that is the sinus at least."""
CORTEX = 1.0 / 3.0
"""Thickness of the cortex over the greatest depth below the capsule, where it isn't given."""


@dataclass(frozen=True)
class KidneyPlaces:
    """Places of a kidney, mm, and unit vectors."""

    entry: FloatArray  # where the vessels enter, on the wall of the sinus
    inward: FloatArray  # the way into the kidney there
    hilum: FloatArray  # out of the hilum
    capsule: FloatArray  # (k, 3), places of the outer surface
    cortex_mm: float

    def below_capsule(self, points: FloatArray) -> FloatArray:
        """Return the depth (n,) of points (n, 3) below the capsule, mm."""
        depth: FloatArray = cKDTree(self.capsule).query(points)[0]
        return depth

    def kept_in_medulla(self, points: FloatArray) -> FloatArray:
        """Return points (n, 3), those in the cortex moved to its inner border."""
        away, near = cKDTree(self.capsule).query(points)
        from_there = points - self.capsule[near]
        short = np.maximum(self.cortex_mm - away, 0.0)
        moved: FloatArray = points + (short / np.maximum(away, 1e-9))[:, None] * from_there
        return moved


def find_kidney_places(shape: Survey, cortex_mm: float | None = None) -> KidneyPlaces:
    """Find the hilum where the surface is least open, and the cortex below all the rest.

    The vessels enter near the given hilum, else in the middle of the sinus.

    Raises
    ------
    TissueError
        Where the surface is as open everywhere, and no hilum is given.
    """
    samples, entry = shape.samples, shape.given.get("hilum")
    least = float(np.quantile(samples.openness, SINUS))
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
        inner = away <= np.quantile(away, SINUS)
    sinus = np.flatnonzero(inner)
    if entry is None:
        middle = samples.points[sinus].mean(axis=0)
        at = int(sinus[nearest(samples.points[sinus], middle)])
    else:
        at = nearest(samples.points, entry)
    out = samples.way_out[inner].sum(axis=0)
    if not np.linalg.norm(out) > 0.0:
        out = -samples.inward[at]  # of a sinus so narrow that no ray leaves it
    capsule = samples.points[~inner]
    depth = cKDTree(capsule).query(shape.volume)[0]
    return KidneyPlaces(
        samples.points[at],
        samples.inward[at],
        out / np.linalg.norm(out),
        capsule,
        cortex_mm if cortex_mm is not None else CORTEX * float(depth.max()),
    )
