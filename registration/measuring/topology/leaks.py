"""Find leaks to the outside and bridges between vessels: paths through the gel, with widths."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from design.network import VesselNetwork
from kernels.arrays import IntArray
from registration.alignment import Fit
from registration.alignment.distance import ModelSurface
from registration.measuring.gauging.changes import bordered
from registration.measuring.gauging.defect import Defect, Doubt
from registration.measuring.gauging.trace import VesselTrace
from registration.measuring.topology.gel_paths import (
    LEAST_MM,
    OUTSIDE,
    SURE,
    LeakPath,
    Scene,
    averaged,
    designed_gel,
    find_gel_paths,
)
from registration.measuring.topology.grid import LumenGrid
from registration.measuring.topology.path_width import outline_width, width
from registration.measuring.topology.shadow_test import may_be_shade
from registration.measuring.topology.swollen_joints import SwollenJoint, swelling
from registration.segmentation import GelField
from registration.segmentation.evidence import SIGMA_MM, GelEvidence, are_separable

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
        Faint ones left out, whose width may be below `THINNEST_MM`: gel's own texture looks so.
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
    scene = Scene(grid, gel, mean, separable, search.liquid, clear)
    ways = [_measured(way, scene, search) for way in find_gel_paths(scene, search.false_alarm)]
    # What stands out from the gel right beside it; a face that lies elsewhere doesn't.
    ways = [f for f in ways if f[1] > THINNEST_MM and (f[0].significance > SURE or f[1] > f[2])]
    told = [f for f in ways if not f[0].faint or f[1] - f[2] > THINNEST_MM]
    unresolved, ways = len(ways) - len(told), told
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
