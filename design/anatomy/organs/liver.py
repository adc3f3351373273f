"""Grow a liver's portal vein and hepatic artery side by side, and hepatic veins between them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from design.anatomy.from_trunks import TrunkPlan
from design.anatomy.organ import AnatomicTrees, Place, Survey, grow_trees, say, survey
from design.anatomy.side_by_side import Companion, side_by_side, tube_options
from design.anatomy.trunk_lines import (
    LayerForest,
    Rank,
    TrunkLines,
    Zone,
    join_layer,
    lines_of,
    nearest,
)
from design.errors import TissueError
from design.network import VesselKind
from design.tissue import Tissue
from design.vasculature.options import GrowthOptions
from kernels.arrays import FloatArray

NAMES: Final = ("portal_vein", "hepatic_artery", "hepatic_veins")
PORTAL_SHARE = 0.75
"""Of the liver's blood, that of the portal vein; the artery has the rest (Eipel et al. 2010,
doi 10.3748/wjg.v16.i48.6046: 75 to 80 %)."""
HEPATIC_ARTERY = Companion(drop=4.0, flow=1.0 / PORTAL_SHARE - 1.0, tube=1.48)
"""Beside the portal vein, then 0.54 times as wide. Four times its pressure drop is ours."""
HEPATIC_DROP = 0.5
"""Pressure drop along the hepatic veins over the portal vein's. Ours."""
NOTE: Final = "portal vein and hepatic artery both stand as arteries in the network: blood flows in"


@dataclass(frozen=True)
class LiverAnatomy:
    """Options of a liver's vessels; what isn't given is found in its shape.

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


class _Trunks(NamedTuple):
    """How a liver's trunks are laid; depths and distances are ours."""

    segments: Rank = Rank(balance=0.5, spacing=0.3, ends=8)  # portal: Couinaud's (1957)
    veins: Rank = Rank(balance=0.5, spacing=0.3, ends=3)  # hepatic: right, middle and left
    others: Rank = Rank(balance=0.3, offered=2)  # of both
    depth: float = 0.03  # of planned trunks over the cube root of the volume
    least_depth: float = 0.3  # of trunks that are pushed aside, over that
    apart: float = 0.6  # of the greatest way from portal trunks, beyond it hepatic ones cost least


TRUNKS = _Trunks()


def grow_liver(
    tissue: Tissue, options: GrowthOptions, anatomy: LiverAnatomy | None = None
) -> AnatomicTrees:
    """Grow portal vein, hepatic artery and hepatic veins of any liver, as many terminals each.

    The options are the portal vein's, but for the flow, which is the liver's.

    The portal vein enters at the porta hepatis, with the artery beside it down to the terminals.
    The hepatic veins gather from between its branches, and leave to the vena cava.

    Raises
    ------
    TissueError, GrowthError
        Where no trunk or tree fits.
    """
    anatomy = anatomy or LiverAnatomy()
    given = {"porta_hepatis": anatomy.porta_mm, "vena_cava": anatomy.cava_mm}
    shape = survey("liver", tissue, options, anatomy.trunk_ends, given)
    places = find_liver_places(shape)
    deep = TRUNKS.depth * float(np.cbrt(tissue.volume_mm3))
    plan = TrunkPlan(_trunk_lines(shape, places, deep), TRUNKS.least_depth * deep, exactly=False)
    notes = (
        f"the diaphragm was taken to lie towards {say(places.up)}; portal vein and artery "
        f"enter at {say(places.porta)} mm, the hepatic veins leave at {say(places.cava)} mm",
        NOTE,
    )
    flow = options.perfusion_ml_min_per_ml
    portal = replace(options, perfusion_ml_min_per_ml=PORTAL_SHARE * flow)
    hepatic = replace(options, pressure_drop_pa=HEPATIC_DROP * options.pressure_drop_pa)
    trees = grow_trees(
        tissue,
        plan,
        options,
        (tube_options(portal, HEPATIC_ARTERY), hepatic),
        lambda made: (*side_by_side(made[0], portal, HEPATIC_ARTERY), made[1]),
    )
    kinds = (VesselKind.ARTERY, VesselKind.ARTERY, VesselKind.VEIN)
    return AnatomicTrees(trees, kinds, NAMES, notes)


def _trunk_lines(shape: Survey, places: LiverPlaces, depth_mm: float) -> TrunkLines:
    """Lay the portal vein's tree from the porta, and the hepatic veins' far from its trunks."""
    layer = join_layer(shape.tissue, shape.places(True, depth_mm), 0.6 * depth_mm)
    zone = Zone.of(layer, 3)
    portal, hepatic = LayerForest(layer), LayerForest(layer)
    portal.plant(0, layer.below(places.porta, places.porta_inward))
    portal.grow(TRUNKS.segments, shape.ends, zone, far_from=places.porta[None])
    portal.grow(TRUNKS.others, shape.ends, zone)
    away = cKDTree(portal.taken).query(layer.points)[0]
    free = np.clip(away / (TRUNKS.apart * away.max()), 0.1, 1.0)
    cost = layer.length * 2.0 / (free[layer.begin] + free[layer.to])
    between = np.flatnonzero(away >= np.median(away))
    hepatic.plant(1, layer.below(places.cava, places.cava_inward))
    hepatic.grow(TRUNKS.veins, shape.ends, zone, between, cost, places.cava[None])
    hepatic.grow(TRUNKS.others, shape.ends, zone, between, cost)
    one = lines_of(portal, {0: places.porta}, shape.volume)
    two = lines_of(hepatic, {1: places.cava}, shape.volume)
    return TrunkLines(
        np.concatenate([one.points, two.points]),
        np.concatenate([one.parent, np.where(two.parent >= 0, two.parent + len(one.parent), -1)]),
        np.concatenate([one.tree, two.tree]),
        np.concatenate([one.share, two.share]),
    )


class _Shape(NamedTuple):
    """How a liver's places are found: shares of the surface, the least open of it first."""

    porta: float = 0.03  # in whose middle the porta hepatis lies
    grooves: float = 0.15  # that all grooves have; the vena cava's is one
    convex: float = 0.95  # openness above which a place lies in no groove
    nearest: float = 0.35  # way from porta to vena cava over the cube root of the volume
    farthest: float = 1.0
    top: float = 0.04  # of the grooves, the highest, in whose middle the hepatic veins leave


SHAPE = _Shape()


@dataclass(frozen=True)
class LiverPlaces:
    """Places (3,) of a liver, mm, and unit vectors."""

    porta: FloatArray  # where portal vein and hepatic artery enter
    porta_inward: FloatArray  # the way into the liver there
    cava: FloatArray  # where the hepatic veins leave to the vena cava
    cava_inward: FloatArray
    up: FloatArray  # from the visceral side to the diaphragm


def find_liver_places(shape: Survey) -> LiverPlaces:
    """Find the porta in the middle of the visceral side's hollow, the veins' exit above it.

    The hollow is where the surface is least open, and what it opens to is below. Of all grooves
    that aren't at the porta, the vena cava's reaches highest. In the one liver that was at hand
    with its vessels, both places lay within 14 mm of the true ones. Given places are taken.

    Raises
    ------
    TissueError
        Where the surface is as open everywhere, or has no groove above the porta.
    """
    samples, given = shape.samples, shape.given
    points = samples.points
    hollow = samples.openness <= np.quantile(samples.openness, SHAPE.porta)
    if hollow.mean() > 0.5 and len(given) < 2:
        raise TissueError(
            "no porta hepatis is found: the surface is as open everywhere; give both places "
            "(anatomy: {inlets: {porta_hepatis: {at_mm: [x, y, z]}, vena_cava: ...}})"
        )
    if "porta_hepatis" in given:
        porta = nearest(points, given["porta_hepatis"])
    else:
        inside = np.flatnonzero(hollow)
        porta = int(inside[nearest(points[inside], points[inside].mean(axis=0))])
    out = samples.way_out[hollow].sum(axis=0)
    up = -out / max(float(np.linalg.norm(out)), 1e-12)
    leaves = given.get("vena_cava")
    if leaves is None:
        leaves = _highest_groove(shape, points[porta], up)
    cava = nearest(points, leaves)
    return LiverPlaces(points[porta], samples.inward[porta], points[cava], samples.inward[cava], up)


def _highest_groove(shape: Survey, porta: FloatArray, up: FloatArray) -> FloatArray:
    """Return the middle (3,) of the highest part of the grooves, the porta's left out."""
    samples, size = shape.samples, float(np.cbrt(shape.tissue.volume_mm3))
    away = np.linalg.norm(samples.points - porta, axis=1)
    openness = samples.openness
    groove = openness <= min(SHAPE.convex, float(np.quantile(openness, SHAPE.grooves)))
    groove &= (away > SHAPE.nearest * size) & (away < SHAPE.farthest * size)
    members = np.flatnonzero(groove)
    if not len(members):
        raise TissueError(
            "no groove of the vena cava is found; give the place where the hepatic veins leave "
            "(anatomy: {inlets: {vena_cava: {at_mm: [x, y, z]}}})"
        )
    height = (samples.points[members] - porta) @ up
    top = members[np.argsort(-height, kind="stable")[: max(1, int(SHAPE.top * len(members)))]]
    middle: FloatArray = samples.points[top].mean(axis=0)
    return middle
