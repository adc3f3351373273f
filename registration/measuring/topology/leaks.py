"""Find leaks and bridges: paths through the gel, their widths, shadows, swollen joints."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from design.geometry.polyline import arc_lengths
from design.network import VesselNetwork
from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.alignment import Fit
from registration.alignment.distance import ModelSurface
from registration.measuring.gauging.changes import bordered
from registration.measuring.gauging.defect import Defect, Doubt
from registration.measuring.gauging.trace import VesselTrace
from registration.measuring.topology.compare import betti_numbers, without_specks
from registration.measuring.topology.gel_paths import (
    LEAST_MM,
    OUTSIDE,
    SURE,
    LeakPath,
    Scene,
    averaged,
    designed_gel,
    find_gel_paths,
    mid_evidence,
)
from registration.measuring.topology.grid import LumenGrid, lay_grid
from registration.measuring.topology.leak_width import outline_width, width
from registration.segmentation import GelField
from registration.segmentation.evidence import GLARE, SIGMA_MM, GelEvidence, Glints, are_separable


def may_be_shade(
    way: LeakPath, width_mm: float, scene: Scene, glints: Glints, surface: ModelSurface, fit: Fit
) -> bool:
    """Return whether a way is none once what lies in the shade of a glint is taken for gel.

    Air in water sends back some thirty decibels more than gel's walls do (Fresnel: 2 % at an index
    of 1 against 1.33, 0.001 % at 1.34 against 1.33), and little light passes it. Gel below it looks
    like liquid down to the end of the A-scan, and no value there can tell. So a way is held again
    against its limit with all that is shaded taken for gel.

    Parameters
    ----------
    way : LeakPath
    width_mm : float, mm
        Of the way: a shadow is as wide as what throws it, and a glint lies anywhere on that.
    scene : Scene
    glints : Glints
    surface : ModelSurface
        Its walls send light back too: a glint near one counts only where it outshines the walls
        of this part `GLARE` times.
    fit : Fit
        Scan to part.
    """
    reach = width_mm / 2 + SIGMA_MM
    path = fit.invert(way.path)
    low, high = path[:, :2].min(axis=0) - reach, path[:, :2].max(axis=0) + reach
    around = ((glints.place[:, :2] > low) & (glints.place[:, :2] < high)).all(axis=1)
    place, share = glints.place[around], glints.share[around]
    away = np.abs(surface.query(fit.apply(place)).distance) if len(place) else np.empty(0)
    counts = (away > scene.clear_mm) | (share > GLARE * glints.usual)
    shaded = _below(path, place[counts], reach, glints.down)
    if not shaded.any():
        return False
    grid = scene.grid
    index = np.round((way.path - grid.origin_mm) / grid.step_mm).astype(np.int64)[:, ::-1]
    index = np.clip(index, 0, np.array(scene.mean.shape) - 1)
    mean = np.nan_to_num(scene.mean[tuple(index.T)].astype(np.float64), nan=1.0)
    return bool(np.where(shaded, 1.0, mean).mean() >= mid_evidence(scene.liquid))


def _below(path: FloatArray, glints: FloatArray, reach: float, down: int) -> BoolArray:
    """Return which places (n, 3) of a path lie below a glint (m, 3) within `reach`; mm, (n,).

    Nearer than twice that it may be the way's own ceiling, which faces the light.
    """
    apart = np.linalg.norm(path[:, None, :2] - glints[None, :, :2], axis=2)
    above = down * (path[:, None, 2] - glints[None, :, 2]) > 2 * reach
    return np.asarray(((apart <= reach) & above).any(axis=1))


# Two vessels that meet at a node are one lumen there. Liquid between them is a bridge only where it
# goes round gel; where it doesn't, the joint itself reaches farther out than designed, as
# overlapping beads make it. Which of the two it is the Betti number of loops says.
_ROUND = 1.25
"""Loops are looked for in a ball about the node, so much larger than the way's farthest place."""
_NEAR_MM = 0.3
"""What is free so near to the way belongs to it."""
_RESOLVED = 1.5
"""Voxels of the scan from liquid that a place on a way may lie: gel between would be seen."""
_SPECK = 8
"""Voxels; fewer that hang together are noise."""


@dataclass(frozen=True)
class SwollenJoint:
    """A joint that reaches into designed gel.

    Attributes
    ----------
    node : int
        In the network.
    out_mm : float, mm
        How far it reaches beyond the designed wall, seen from the node.
    tip_mm : (3,) float64, mm
        Where it reaches farthest, part frame.
    """

    node: int
    out_mm: float
    tip_mm: FloatArray


def swelling(
    way: LeakPath, network: VesselNetwork, field: GelField, fit: Fit, clear_mm: float
) -> SwollenJoint | None:
    """Return the swelling of a joint that a way is part of.

    None where the way goes round gel, and where the scan doesn't resolve it as liquid.

    Parameters
    ----------
    way : LeakPath
    network : VesselNetwork
        The design.
    field : GelField
        The scan's gel.
    fit : Fit
        Scan to part.
    clear_mm : float, mm
        What is free nearer to a designed wall is no swelling.
    """
    first, second = way.ends
    if second == OUTSIDE:
        return None
    for node in np.intersect1d(network.vessel_nodes[first], network.vessel_nodes[second]):
        middle = network.nodes[node]
        reach = _ROUND * float(np.linalg.norm(way.path - middle, axis=1).max())
        voxel = float(field.voxel_mm.max())
        bounds = np.stack([middle - reach, middle + reach])
        # Finer than the whole part's grid, whose voxels may be as wide as a way.
        grid = lay_grid(network, field, fit, bounds, float(field.voxel_mm.min()) / 2, reach)
        joint = _about(int(node), middle, way.path, grid, (clear_mm, voxel, reach))
        if joint is not None:
            return joint
    return None


def _about(
    node: int,
    middle: FloatArray,
    path: FloatArray,
    grid: LumenGrid,
    sizes: tuple[float, float, float],
) -> SwollenJoint | None:
    """Swelling about a node at `middle`; `sizes`: wall's rim, scan's voxel, ball's radius, mm."""
    clear, voxel, ball = sizes
    places = grid.places(np.argwhere(np.ones(grid.free.shape, dtype=np.bool_)))
    away = np.linalg.norm(places - middle, axis=1).reshape(grid.free.shape)
    lumen = (grid.wall_mm <= 0) | (grid.free & grid.known)
    lumen = _connected(without_specks(lumen, _SPECK) & (away <= ball), away)
    open_ = places[lumen.ravel()]
    apart = np.array([np.linalg.norm(open_ - place, axis=1).min() for place in path])
    if apart.max() > _RESOLVED * voxel or betti_numbers(lumen).loops:
        return None
    free = places[(lumen & (grid.wall_mm > clear)).ravel()]
    near = np.array([np.linalg.norm(path - p, axis=1).min() <= _NEAR_MM for p in free], dtype=bool)
    # Where nothing is free so far from the walls, the way itself is all there is of it.
    return _farthest(node, middle, free[near] if near.any() else path, grid)


def _connected(lumen: BoolArray, away: FloatArray) -> BoolArray:
    """What hangs together with the place nearest to the node."""
    label, _ = ndimage.label(lumen)
    return np.asarray(lumen & (label == label.ravel()[int(np.argmin(away))]))


def _farthest(node: int, middle: FloatArray, swollen: FloatArray, grid: LumenGrid) -> SwollenJoint:
    """Find the place of (n, 3), mm, before which the most designed gel lies, from the node."""
    reach = np.linalg.norm(swollen - middle, axis=1)
    share = np.linspace(0.0, 1.0, int(np.ceil(2 * reach.max() / grid.step_mm)) + 1)
    places = middle + share[:, None, None] * (swollen - middle)
    index = np.round((places - grid.origin_mm) / grid.step_mm).astype(np.int64)[..., ::-1]
    gel = grid.wall_mm[tuple(np.moveaxis(index, -1, 0))] > 0
    out = gel.mean(axis=0) * reach
    worst = int(np.argmax(out))
    return SwollenJoint(node, float(out[worst]), swollen[worst])


def is_open(way: LeakPath, scene: Scene, field: GelField, fit: Fit) -> bool:
    """Return whether what the scan shows free of gel runs through from end to end of a way.

    Only through gel by design: beside a joint its lumens would join the ends.

    A channel as wide as the scan resolves lies below the gel's level all along it. Gel between
    voids, or a channel narrower than that, rises above it somewhere, and nothing there can tell the
    two.
    """
    step = float(field.voxel_mm.min()) / 2
    along = arc_lengths(way.path)
    even = np.linspace(0.0, along[-1], int(along[-1] / step) + 2)
    path = np.stack([np.interp(even, along, way.path[:, k]) for k in range(3)], axis=1)
    path = path[scene.is_gel(path)]
    if len(path) < 2:
        return False
    reach = LEAST_MM / 2 + scene.grid.step_mm
    sides = [
        np.arange(low, high + step, step)
        for low, high in zip(path.min(axis=0) - reach, path.max(axis=0) + reach, strict=True)
    ]
    places = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1)
    away, nearest = cKDTree(path).query(places)
    free = (field.above_level(fit.invert(places.reshape(-1, 3))) < 0).reshape(away.shape)
    label, _ = ndimage.label(free & (away <= reach) & scene.is_gel(places))
    first, last = label[nearest <= 1], label[nearest >= len(path) - 2]
    return bool(set(first[first > 0].tolist()) & set(last.tolist()))


THINNEST_MM = LEAST_MM / 3
"""No way is thinner, nor a faint one by the lower end of its interval."""
_FULL = np.ones((3, 3, 3), dtype=np.bool_)


@dataclass(frozen=True)
class Leaks:
    """Leaks and bridges found in a print.

    Attributes
    ----------
    defects : tuple of Defect
        Leaks and bridges.
    swellings : tuple of Defect
        Bulges: joints that fill their crotch, with no gel between.
    bridges : (n, 3) int64
        Voxels (z, y, x) of the grid that bridges consist of.
    examined : float
        Share of the designed gel, clear of walls, in which they could be told.
    unresolved : int
        Ways left out that the scan doesn't show to be open: closed voids, and gel's own texture,
        look like them.
    """

    defects: tuple[Defect, ...]
    swellings: tuple[Defect, ...]
    bridges: IntArray
    examined: float
    unresolved: int


@dataclass(frozen=True)
class LeakSearch:
    """What leaks are looked for in.

    Attributes
    ----------
    grid : LumenGrid
        Design and scan.
    surface : ModelSurface
        The model; of a construct it tells where the gel ends.
    model_is_lumen : bool
        Whether it is the lumens alone: what leads farther from them than the grid reaches then
        leads outside.
    wall_mm : float, mm
        How far walls usually deviate; gel thinner than four times this isn't examined.
    false_alarm : float
        Probability that a scan of sound gel shows one.
    field : GelField
        The scan's gel.
    evidence : GelEvidence
        Of the scan.
    liquid : float
        Evidence for gel in the lumens.
    fit : Fit
        Scan to part.
    network : VesselNetwork
        The design.
    """

    grid: LumenGrid
    surface: ModelSurface
    model_is_lumen: bool
    wall_mm: float
    false_alarm: float
    field: GelField
    evidence: GelEvidence
    liquid: float
    fit: Fit
    network: VesselNetwork


def find_leaks(search: LeakSearch, traces: tuple[VesselTrace, ...]) -> Leaks:
    """Return leaks and bridges; one trace a vessel, in the network's order."""
    grid = search.grid
    clear = 2 * search.wall_mm + SIGMA_MM
    gel = designed_gel(grid, search.surface, search.model_is_lumen, clear)
    mean, scatter = averaged(grid, search.evidence, search.fit)
    separable = are_separable(1.0, search.liquid, scatter.astype(np.float64))
    scene = Scene(grid, gel, mean, separable, search.liquid, clear, scatter)
    found = [
        (way, _measured(way, scene, search)) for way in find_gel_paths(scene, search.false_alarm)
    ]
    # What stands out from the gel right beside it; a face that lies elsewhere doesn't.
    found = [
        (way, (moved, size, error))
        for way, (moved, size, error) in found
        if size > THINNEST_MM and (way.significance > SURE or size > error)
    ]
    ways = [one for way, one in found if _is_told(way, *one[1:], scene, search)]
    unresolved = len(found) - len(ways)
    swollen = [swelling(way, search.network, search.field, search.fit, clear) for way, *_ in ways]
    swellings = [
        _swollen(way, one, search, traces)
        for (way, *_), one in zip(ways, swollen, strict=True)
        if one is not None
    ]
    ways = [one_way for one_way, one in zip(ways, swollen, strict=True) if one is None]
    between = [_voxels(way, scene) for way, *_ in ways if way.ends[1] != OUTSIDE]
    return Leaks(
        tuple(_defect(*one_way, _doubt(*one_way[:2], scene, search), traces) for one_way in ways),
        tuple(swellings),
        np.concatenate([np.empty((0, 3), dtype=np.int64), *between]),
        scene.examined,
        unresolved,
    )


def _measured(way: LeakPath, scene: Scene, search: LeakSearch) -> tuple[LeakPath, float, float]:
    """Return a way, moved to its axis, its diameter and half its 95 % interval, mm."""
    if not search.evidence.speckled:
        outlined = outline_width(way.path, search.field, search.fit)
        if np.isfinite(outlined[0]):
            return (way, *outlined)
    size, error, shift = width(way.path, scene, search.evidence, search.fit)
    return replace(way, path=way.path + shift), size, error


def _is_told(way: LeakPath, size: float, error: float, scene: Scene, search: LeakSearch) -> bool:
    """Return whether a way is more likely one than gel with voids.

    Single places of speckle tell less than the mean along a way does: where that surely lacks
    enough gel it counts whatever they show.
    """
    if way.faint and size - error <= THINNEST_MM:
        return False
    if search.evidence.speckled and not way.faint:
        return way.significance > SURE
    return is_open(way, scene, search.field, search.fit)


def _voxels(way: LeakPath, scene: Scene) -> IntArray:
    """Voxels of the grid within one of a way's path."""
    grid = scene.grid
    index = np.round((way.path - grid.origin_mm) / grid.step_mm).astype(np.int64)[:, ::-1]
    low = np.maximum(index.min(axis=0) - 2, 0)
    high = np.minimum(index.max(axis=0) + 3, grid.free.shape)
    box = np.zeros(high - low, dtype=np.bool_)
    box[tuple((index - low).T)] = True
    return np.argwhere(ndimage.binary_dilation(box, structure=_FULL)) + low


def _doubt(way: LeakPath, size: float, scene: Scene, search: LeakSearch) -> Doubt:
    if way.faint:
        return "faint"
    glints = search.evidence.glints
    return "shade" if may_be_shade(way, size, scene, glints, search.surface, search.fit) else ""


def _defect(
    way: LeakPath, size: float, error: float, doubt: Doubt, traces: tuple[VesselTrace, ...]
) -> Defect:
    vessel, other = way.ends
    trace = traces[vessel]
    nearest = int(np.linalg.norm(trace.centre - way.path[0], axis=1).argmin())
    at, half = float(trace.along[nearest]), max(size, trace.spacing) / 2
    x, y, z = way.path[len(way.path) // 2].tolist()
    return Defect(
        kind="leak" if other == OUTSIDE else "bridge",
        vessel=vessel,
        other=None if other == OUTSIDE else other,
        from_mm=at - half,
        to_mm=at + half,
        at_mm=at,
        point_mm=(x, y, z),
        size_um=1e3 * size,
        error_um=1e3 * error,
        percent=float("nan"),
        wall_um=float("nan"),
        significance=way.significance,
        seen=bordered(trace, (at - half, at + half)),
        doubt=doubt,
    )


def _swollen(
    way: LeakPath, joint: SwollenJoint, search: LeakSearch, traces: tuple[VesselTrace, ...]
) -> Defect:
    """Bulge of the narrower vessel by as much as the joint reaches out beyond the design."""
    trace = min(
        (traces[vessel] for vessel in way.ends), key=lambda one: float(np.median(one.radius))
    )
    at = 0.0 if search.network.vessel_nodes[trace.vessel][0] == joint.node else trace.length
    radius = float(trace.radius[0 if at == 0.0 else -1])
    far = float(
        np.clip(np.linalg.norm(joint.tip_mm - search.network.nodes[joint.node]), 0, trace.length)
    )
    error = float(np.hypot(search.grid.step_mm / np.sqrt(12), search.wall_mm))
    x, y, z = joint.tip_mm.tolist()
    return Defect(
        kind="bulge",
        vessel=trace.vessel,
        other=None,
        from_mm=0.0 if at == 0.0 else trace.length - far,
        to_mm=far if at == 0.0 else trace.length,
        at_mm=at,
        point_mm=(x, y, z),
        size_um=1e3 * joint.out_mm,
        error_um=1.96e3 * error,
        percent=100 * joint.out_mm / (2 * radius),
        wall_um=1e3 * joint.out_mm,
        significance=joint.out_mm / error,
        seen=True,
    )
