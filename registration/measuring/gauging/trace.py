"""Measure cross-sections of every vessel in an aligned scan, along its axis."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from design.geometry.polyline import arc_lengths, places_along
from design.network import VesselNetwork
from kernels.arrays import BoolArray, FloatArray
from registration.alignment import Fit
from registration.alignment.distance import ModelSurface
from registration.measuring.gauging.sections import (
    LEAST_MET,
    RAYS,
    Planes,
    Sections,
    cut_sections,
    partial_noise,
)
from registration.segmentation import Segmentation
from registration.segmentation.volume import sample


def stations(
    network: VesselNetwork, vessel: int, spacing_mm: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Evenly spaced places along a vessel, in the part's frame.

    Returns
    -------
    along : (n,) float64, mm
        From the vessel's first node; ends are half a spacing off the nodes.
    centre, tangent : (n, 3) float64
        Position and unit direction.
    radius : (n,) float64, mm
        Designed.
    """
    points, radii = network.polyline(vessel)
    path = arc_lengths(points)
    count = max(3, int(np.ceil(path[-1] / spacing_mm)))
    along = (np.arange(count) + 0.5) * path[-1] / count
    centre = places_along(points, path, along)
    # A chord over about a radius, so that a kinked polyline's planes don't jump.
    reach = np.maximum(np.interp(along, path, radii), spacing_mm) / 2
    ends = [np.clip(along + side * reach, 0, path[-1]) for side in (1, -1)]
    chord = places_along(points, path, ends[0]) - places_along(points, path, ends[1])
    tangent = chord / np.linalg.norm(chord, axis=1, keepdims=True)
    return along, centre, tangent, np.interp(along, path, radii)


def to_scan(centre: FloatArray, tangent: FloatArray, radius: FloatArray, fit: Fit) -> Planes:
    """Planes across the centreline, carried into the scan's frame.

    Positions follow the fitted map; lengths stay those of the scan, so that diameters are those
    of the print as it is.
    """
    return Planes(fit.invert(centre), across_tangents(tangent @ fit.rotation), radius)


def across_tangents(direction: FloatArray) -> FloatArray:
    """Two unit vectors across each unit direction (n, 3) and each other, (n, 2, 3)."""
    helper = np.where(np.abs(direction[:, 2:]) < 0.8, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(helper, direction)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(direction, first)], axis=1)


def clearances(network: VesselNetwork) -> FloatArray:
    """How far from its first and last node each vessel is free of its neighbours, (v, 2), mm.

    Two round lumens of radii r and R that leave a node at the angle φ part where
    t = (R + r cos φ) / sin φ along the first; continuing straight on they never overlap sideways.
    """
    ends = np.stack(
        [
            [_leaving(network, v, last) for last in (False, True)]
            for v in range(network.vessel_count)
        ]
    )
    radius = np.array(
        [[network.polyline(v)[1][k] for k in (0, -1)] for v in range(network.vessel_count)]
    )
    at_node: dict[int, list[tuple[int, int]]] = {}
    for vessel, side in np.ndindex(network.vessel_count, 2):
        at_node.setdefault(int(network.vessel_nodes[vessel, side]), []).append((vessel, side))
    out = np.zeros((network.vessel_count, 2))
    for meeting in at_node.values():
        for here in meeting:
            for other in meeting:
                if other != here:
                    cosine = float(ends[here] @ ends[other])
                    sine = max(np.sqrt(max(0.0, 1 - cosine**2)), 0.05)
                    reach = (radius[other] + radius[here] * cosine) / sine
                    limit = 4 * max(radius[other], radius[here])
                    out[here] = max(out[here], min(max(reach, 0.0), limit))
    return out


def _leaving(network: VesselNetwork, vessel: int, last: bool) -> FloatArray:
    """Unit direction in which a vessel leaves its first (or last) node."""
    points, radii = network.polyline(vessel)
    if last:
        points, radii = points[::-1], radii[::-1]
    away = np.linalg.norm(points - points[0], axis=1)
    far = int(np.argmax(away >= min(2 * radii[0], away.max())))
    return np.asarray((points[far] - points[0]) / away[far])


_ANGLES = 2 * np.pi * np.arange(16) / 16


class Neighbours:
    """The lumens around each vessel of a network."""

    def __init__(self, network: VesselNetwork) -> None:
        self._network = network
        start, end, r0, r1, vessel = network.pieces()
        self._start, self._way, self._r0, self._dr = start, end - start, r0, r1 - r0
        self._vessel = vessel
        self._at_node: dict[int, set[int]] = {}
        for index, ends in enumerate(network.vessel_nodes.tolist()):
            for node in ends:
                self._at_node.setdefault(node, set()).add(index)

    def free_wall(
        self, vessel: int, centre: FloatArray, tangent: FloatArray, radius: FloatArray
    ) -> FloatArray:
        """Share of the designed wall around each station that no neighbour's lumen holds.

        Parameters
        ----------
        vessel : int
        centre, tangent : (n, 3)
            Stations along it, mm.
        radius : (n,) mm
            Designed.

        Returns
        -------
        (n,) float64, 0 to 1
        """
        pieces = np.flatnonzero(np.isin(self._vessel, sorted(self._around(vessel))))
        if len(pieces) == 0:
            return np.ones(len(centre))
        wall = _rings(centre, tangent, radius)
        way = self._way[pieces]
        off = wall[:, :, None] - self._start[pieces]
        along = np.einsum("srpk,pk->srp", off, way) / np.einsum("pk,pk->p", way, way)
        along = np.clip(along, 0.0, 1.0)
        away = np.linalg.norm(off - along[..., None] * way, axis=-1)
        inside = (away < self._r0[pieces] + along * self._dr[pieces]).any(axis=-1)
        return 1.0 - np.asarray(inside.mean(axis=1))

    def _around(self, vessel: int) -> set[int]:
        """Vessels that meet ``vessel``, and those that meet them: a short one doesn't part two."""
        near = self._meeting(vessel)
        return set().union(near, *(self._meeting(other) for other in near)) - {vessel}

    def _meeting(self, vessel: int) -> set[int]:
        first, last = self._network.vessel_nodes[vessel].tolist()
        return self._at_node[first] | self._at_node[last]


def _rings(centre: FloatArray, tangent: FloatArray, radius: FloatArray) -> FloatArray:
    """Points (n, 16, 3) on circles across the tangents."""
    across = across_tangents(tangent)
    circle = np.cos(_ANGLES)[:, None] * across[:, :1] + np.sin(_ANGLES)[:, None] * across[:, 1:]
    return np.asarray(centre[:, None] + radius[:, None, None] * circle)


_RING, _MOST_OF_RING = 12, 0.75
"""Points around a lumen, and the share of them in the part where it is one of its sections."""
_ANGLE = 2 * np.pi * np.arange(_RING) / _RING
_CIRCLE = np.stack([np.cos(_ANGLE), np.sin(_ANGLE)], axis=1)
_BEHIND_WALL = np.array([2.0, 3.0, 4.0])
"""Voxels from a lumen's wall at which light is looked for in the gel."""
_SURE_LIGHT = 3.0
"""Standard errors of the mean there that are no noise."""
_FREE_WALL = 0.95
"""Less of a wall of its own, and the median of the rays across a section could meet another's."""


@dataclass(frozen=True)
class VesselTrace:
    """A vessel's stations and what was found there.

    Attributes
    ----------
    vessel : int
        Its number in the network.
    length : float, mm
        Designed.
    along : (n,) float64, mm
        Of the stations, from the vessel's first node.
    centre : (n, 3) float64, mm
        On the designed axis, in the part's frame.
    radius : (n,) float64, mm
        Designed.
    planes : Planes
        The cuts, in the scan's frame.
    sections : Sections
        What they show.
    seen : (n,) bool
        In the field of view and, in OCT, reached by light.
    apart : (n,) bool
        Clear of junctions and ends.
    counted : (n,) bool
        Seen, with a diameter (0 where closed) that is the vessel's own.
    own : (n,) bool
        With (nearly) all of its wall its own by design: where a diameter should be measured.
    to_end : (n,) float64, mm
        Way to the nearest free end, where the lumen opens; inf without one.
    short : bool
        No station lies clear; diameters are twice the median ray's.
    gel_like : (n,) bool
        Not seen, for something brightens the core of the lumen (`gauging.gel_like`).
    wall : (n, `RAYS`) float64, mm
        Designed wall from the axis, along the same rays as the sections'; NaN where there is none.
    level_u : float, mm
        Standard uncertainty of its diameters by thin gel beside them (`gauging.own_levels`).
    """

    vessel: int
    length: float
    along: FloatArray
    centre: FloatArray
    radius: FloatArray
    planes: Planes
    sections: Sections
    seen: BoolArray
    apart: BoolArray
    counted: BoolArray
    own: BoolArray
    to_end: FloatArray
    short: bool
    gel_like: BoolArray
    wall: FloatArray
    level_u: float = 0.0

    @property
    def spacing(self) -> float:
        """Between stations, mm."""
        return self.length / len(self.along)

    @property
    def diameter(self) -> FloatArray:
        """Measured at each station, (n,), mm; NaN where not counted."""
        measured = self.sections.diameter
        if self.short:
            measured = np.where(self.sections.open, self.sections.median, 0.0)
        return np.where(self.counted, measured, np.nan)

    @property
    def designed(self) -> FloatArray:
        """Designed at each station, (n,), mm, measured like `diameter`: of the designed wall.

        Twice the network's radius where the design has no wall to measure.
        """
        met: BoolArray = np.isfinite(self.wall)
        if self.short:
            known = np.where(met.any(axis=1, keepdims=True), self.wall, self.radius[:, None])
            return np.asarray(2 * np.nanmedian(known, axis=1))
        squares = np.where(met, self.wall, 0.0) ** 2
        mean = np.sqrt(squares.sum(axis=1) / np.maximum(met.sum(axis=1), 1))
        return np.where(met.mean(axis=1) >= LEAST_MET, 2 * mean, 2 * self.radius)


def trace_vessels(
    network: VesselNetwork,
    segmentation: Segmentation,
    fit: Fit,
    spacing_mm: float,
    part: ModelSurface | None = None,
) -> tuple[VesselTrace, ...]:
    """Cut every vessel of a network across, in an aligned scan.

    Parameters
    ----------
    network : VesselNetwork
        The design.
    segmentation : Segmentation
        Of the scan.
    fit : Fit
        Scan to part; the scaled one, so that sections follow the print.
    spacing_mm : float, mm
        Between sections.
    part : ModelSurface, optional
        The designed part: an axis may run on past its face, where there is no wall to measure.
        Without it lumens open where their axes end.
    """
    neighbours = Neighbours(network)
    degree = network.degree()[network.vessel_nodes]
    # An end face is rounded by the smoothing, a junction's rim as well.
    border = 2 * float(segmentation.field.voxel_mm.max())
    trim = np.where(degree > 1, 1.05 * clearances(network) + border, 2 * border)
    lengths = network.lengths()
    return tuple(
        _trace(
            vessel,
            float(lengths[vessel]),
            stations(network, vessel, spacing_mm),
            trim[vessel],
            degree[vessel] == 1,
            border,
            (segmentation, fit, neighbours, part),
        )
        for vessel in range(network.vessel_count)
    )


def _trace(
    vessel: int,
    length: float,
    where: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    trim: FloatArray,
    free: BoolArray,
    border: float,
    scene: tuple[Segmentation, Fit, Neighbours, ModelSurface | None],
) -> VesselTrace:
    along, centre, tangent, radius = where
    segmentation, fit, neighbours, part = scene
    rim = centre[:, None] + (radius + border)[:, None, None] * (_CIRCLE @ across_tangents(tangent))
    inside = _inside(part, rim)
    mouths = _mouths(inside, length) * free
    planes = to_scan(centre, tangent, radius, fit)
    sections = cut_sections(segmentation.field, planes)
    apart = (along > mouths[0] + trim[0]) & (along < length - mouths[1] - trim[1])
    # Beside a vessel that leaves at a narrow angle there is still no gel thick enough to be told.
    apart &= neighbours.free_wall(vessel, centre, tangent, radius + border) == 1.0
    # Within a junction there is no gel around to send light back.
    seen = _in_field(segmentation, fit.invert(rim.reshape(-1, 3)), inside)
    # Where the rim lies in a junction's lumen no wall is asked for, but a view of the axis is.
    seen &= np.isfinite(segmentation.field.above_level(planes.centre))
    seen &= _reached(segmentation, planes) | ~apart
    ways = np.where(free[:, None], [along - mouths[0], length - mouths[1] - along], np.inf)
    to_end = np.asarray(ways.min(axis=0))
    # Light that goes past an upright face makes the last of a lumen as bright as gel.
    seen &= sections.open | (to_end > 2 * border)
    short = not apart.any()
    if short:
        # Its middle third, and there whole sections. Where there is none half of the rays must meet
        # the wall: those that look into a neighbour hardly sway the median.
        own = neighbours.free_wall(vessel, centre, tangent, radius) >= _FREE_WALL
        own &= np.abs(along - length / 2) <= length / 6
        whole = seen & own & sections.closed_outline
        enough = whole if whole.any() else sections.met >= 0.5
        counted = seen & own & (enough | ~sections.open)
        partial = partial_noise(sections, segmentation.field.blur_mm)
        noise = np.where(sections.closed_outline, sections.noise, partial)
        sections = replace(sections, noise=noise)
    else:
        own = apart
        counted = seen & own & (sections.closed_outline | ~sections.open)
    return VesselTrace(
        vessel, length, along, centre, radius, planes, sections, seen, apart, counted, own, to_end,
        short, np.zeros(len(along), dtype=np.bool_), np.tile(radius[:, None], (1, RAYS)),
    )  # fmt: skip


def _inside(part: ModelSurface | None, rim: FloatArray) -> BoolArray:
    """Which points (n, `_RING`, 3) of the rims around lumens lie in the part; all without one."""
    if part is None:
        return np.ones(rim.shape[:2], dtype=np.bool_)
    return np.asarray(part.query(rim.reshape(-1, 3)).distance.reshape(rim.shape[:2]) < 0)


def _mouths(inside: BoolArray, length: float) -> FloatArray:
    """How far before the part's face each end of an axis lies, (2,), mm; 0 where it doesn't.

    A station is within the part where most of the rim around its lumen is. Ends are looked for
    in their own half; a vessel with hardly any wall has none.
    """
    within = inside.mean(axis=1) >= _MOST_OF_RING
    half, step = (len(within) + 1) // 2, length / len(within)
    return np.array([step * np.argmax(end[:half]) for end in (within, within[::-1])])


def _in_field(segmentation: Segmentation, rim: FloatArray, inside: BoolArray) -> BoolArray:
    """Whether the wall around a lumen lies in the field of view, wherever the design has one.

    An axis that meets the part's face at a slant has its last stations half in the bath, where
    there is no wall to be seen.
    """
    known = np.isfinite(segmentation.field.above_level(rim)).reshape(inside.shape)
    return np.asarray((known | ~inside).all(axis=1))


def _reached(segmentation: Segmentation, planes: Planes) -> BoolArray:
    """Whether light came back from the gel around the designed lumen; always, without light.

    A voxel's noise, with the floor taken off, has at most that floor as its standard deviation: the
    mean of many tells far weaker light from none.
    """
    if segmentation.strength is None:
        return np.ones(len(planes.centre), dtype=np.bool_)
    field, strength = segmentation.field, segmentation.strength
    margins = _BEHIND_WALL * float(field.voxel_mm.max())
    reach = (planes.radius[:, None] + margins)[..., None, None]
    rings = reach * (_CIRCLE @ planes.across)[:, None]
    where = (planes.centre[:, None, None] + rings - field.origin_mm) / field.voxel_mm
    flat = np.ascontiguousarray(where.reshape(-1, 3))
    around = np.nan_to_num(sample(strength.signal, flat)).reshape(len(planes.centre), -1)
    error = strength.noise / np.sqrt(around.shape[1])
    return np.asarray(around.mean(axis=1) > _SURE_LIGHT * error)
