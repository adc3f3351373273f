"""Ways through the gel that the design doesn't have: leaks to the outside, bridges between vessels.

Free space that lies deeper in the designed gel than the walls deviate anyway is looked at. Each
connected piece of it is asked where it leads; then it is cut across along its way, as a vessel is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from registration.alignment import Fit
from registration.distance import ModelSurface
from registration.gauging.changes import bordered
from registration.gauging.defect import Defect
from registration.gauging.planes import to_scan
from registration.gauging.sections import cut
from registration.gauging.trace import VesselTrace
from registration.segmentation import GelField
from registration.topology.grid import LumenGrid

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

OUTSIDE = -1
_FULL = np.ones((3, 3, 3), dtype=np.bool_)
_CUTS = 15
"""Sections along a leak, over the middle of its way."""


@dataclass(frozen=True)
class _Way:
    """A connected piece of free space in the designed gel, and where it leads.

    Attributes
    ----------
    voxels : (n, 3) int64
        z, y, x.
    mouths : dict
        Vessel (or `OUTSIDE`) to the mean place, (3,) mm, where it opens there.
    """

    voxels: IntArray
    mouths: dict[int, FloatArray]


@dataclass(frozen=True)
class Leaks:
    """What leads through the designed gel.

    Attributes
    ----------
    defects : tuple of Defect
        Leaks and bridges.
    bridges : (n, 3) int64
        Voxels (z, y, x) of the grid that bridges consist of.
    """

    defects: tuple[Defect, ...]
    bridges: IntArray


def find_leaks(
    grid: LumenGrid,
    surface: ModelSurface,
    model_is_lumen: bool,
    margin_mm: float,
    traces: tuple[VesselTrace, ...],
    scan: tuple[GelField, Fit],
) -> Leaks:
    """Leaks and bridges.

    Parameters
    ----------
    grid : LumenGrid
        Design and scan.
    surface : ModelSurface
        The model; of a construct it tells where the gel ends.
    model_is_lumen : bool
        Whether it is the lumens alone: what leads farther from them than the grid reaches then
        leads outside.
    margin_mm : float, mm
        How far free space may lie from a designed wall before it is looked at; more than walls
        deviate. Gel thinner than twice this isn't examined.
    traces : tuple of VesselTrace
        One a vessel, in the network's order.
    scan : (GelField, Fit)
        The gel, and scan to part.
    """
    ways = _ways(grid, surface, model_is_lumen, margin_mm)
    found = [(way, _defect(way, grid, traces, scan)) for way in ways if len(way.mouths) > 1]
    between = [way.voxels for way, defect in found if defect.kind == "bridge"]
    return Leaks(
        tuple(defect for _, defect in found),
        np.concatenate([np.empty((0, 3), dtype=np.int64), *between]),
    )


def _ways(
    grid: LumenGrid, surface: ModelSurface, model_is_lumen: bool, margin: float
) -> list[_Way]:
    far = grid.known & grid.free & (grid.wall_mm > margin)
    index = np.argwhere(far)
    if len(index) == 0:
        return []
    if model_is_lumen:
        inside = grid.wall_mm[far] < grid.reach_mm
    else:
        inside = surface.query(grid.places(index)).distance < -margin
    deep = np.zeros_like(far)
    deep[tuple(index[inside].T)] = True
    beyond = far & ~deep
    near = grid.known & grid.free & ~far
    label, count = ndimage.label(deep, structure=_FULL)
    boxes = ndimage.find_objects(label)
    ways = [_way(label, n + 1, boxes[n], near, beyond, grid) for n in range(count)]
    return [way for way in ways if way is not None]


def _way(
    label: NDArray[np.int32],
    number: int,
    box: tuple[slice, slice, slice],
    near: BoolArray,
    beyond: BoolArray,
    grid: LumenGrid,
) -> _Way | None:
    """Where one piece of free space leads; None for a speck."""
    wide = tuple(slice(max(0, s.start - 1), s.stop + 1) for s in box)
    own = label[wide] == number
    corner = np.array([s.start for s in wide])
    voxels = np.argwhere(own) + corner
    # Noise as wide as a voxel each way leads nowhere.
    if len(voxels) < 4:
        return None
    rim = ndimage.binary_dilation(own, structure=_FULL) & ~own
    mouths: dict[int, FloatArray] = {}
    beside = np.argwhere(rim & near[wide]) + corner
    owners = grid.owner[tuple(beside.T)]
    for vessel in np.unique(owners[owners >= 0]).tolist():
        mouths[vessel] = grid.places(beside[owners == vessel]).mean(axis=0)
    outer = np.argwhere(rim & beyond[wide]) + corner
    if len(outer):
        mouths[OUTSIDE] = grid.places(outer).mean(axis=0)
    return _Way(voxels, _apart(mouths, grid.step_mm))


def _apart(mouths: dict[int, FloatArray], step: float) -> dict[int, FloatArray]:
    """Without vessels whose mouth is another's: beside a junction two vessels share one."""
    kept: dict[int, FloatArray] = {}
    for vessel, place in mouths.items():
        if all(np.linalg.norm(place - other) > 4 * step for other in kept.values()):
            kept[vessel] = place
    return kept


def _defect(
    way: _Way, grid: LumenGrid, traces: tuple[VesselTrace, ...], scan: tuple[GelField, Fit]
) -> Defect:
    vessels = sorted(vessel for vessel in way.mouths if vessel != OUTSIDE)
    vessel = vessels[0]
    leak = OUTSIDE in way.mouths
    begin = way.mouths[vessel]
    end = way.mouths[OUTSIDE if leak else vessels[1]]
    size, error = _width(way, grid, begin, end, scan)
    trace = traces[vessel]
    nearest = int(np.linalg.norm(trace.centre - begin, axis=1).argmin())
    at, half = float(trace.along[nearest]), max(size, trace.spacing) / 2
    middle = grid.places(way.voxels).mean(axis=0).tolist()
    return Defect(
        kind="leak" if leak else "bridge",
        vessel=vessel,
        other=None if leak else vessels[1],
        from_mm=at - half,
        to_mm=at + half,
        at_mm=at,
        point_mm=(middle[0], middle[1], middle[2]),
        size_um=1e3 * size,
        error_um=1e3 * error,
        percent=float("nan"),
        wall_um=float("nan"),
        significance=float("inf"),
        seen=bordered(trace, (at - half, at + half)),
    )


def _width(
    way: _Way,
    grid: LumenGrid,
    begin: FloatArray,
    end: FloatArray,
    scan: tuple[GelField, Fit],
) -> tuple[float, float]:
    """Median diameter of a way from `begin` to `end`, and half its 95 % interval, mm."""
    field, fit = scan
    length = float(np.linalg.norm(end - begin))
    volume = len(way.voxels) * grid.step_mm**3
    radius = float(np.sqrt(volume / (np.pi * max(length, grid.step_mm))))
    radius = max(radius, grid.step_mm)
    share = np.linspace(0.15, 0.85, _CUTS)[:, None]
    centre = begin + share * (end - begin)
    tangent = np.broadcast_to((end - begin) / length, centre.shape)
    sections = cut(field, to_scan(centre, tangent, np.full(_CUTS, 1.5 * radius), fit))
    found = sections.diameter[sections.closed_outline]
    if len(found) < 3:
        # Too short or too crooked to be cut: by volume, as good as the voxels.
        return 2 * radius, grid.step_mm
    scatter = 1.4826 * float(np.median(np.abs(found - np.median(found))))
    noise = float(np.median(sections.noise[sections.closed_outline]))
    return float(np.median(found)), 1.96 * float(np.hypot(noise, scatter / np.sqrt(len(found))))
