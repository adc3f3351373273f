"""Measure cross-sections of every vessel in an aligned scan, evenly spaced along its axis."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from design.network import VesselNetwork
from kernels.arrays import BoolArray, FloatArray
from registration.alignment import Fit
from registration.alignment.distance import ModelSurface
from registration.measuring.gauging.neighbours import Neighbours
from registration.measuring.gauging.planes import across_tangents, clearances, stations, to_scan
from registration.measuring.gauging.sections import Planes, Sections, cut_sections, partial_noise
from registration.segmentation import Segmentation
from registration.segmentation.volume import sample

_RING, _MOST_OF_RING = 12, 0.75
"""Points around a lumen, and the share of them in the part where it is one of its sections."""
_ANGLE = 2 * np.pi * np.arange(_RING) / _RING
_CIRCLE = np.stack([np.cos(_ANGLE), np.sin(_ANGLE)], axis=1)
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
        short, np.zeros(len(along), dtype=np.bool_),
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
    """Whether light came back from the gel around the designed lumen; always, without light."""
    if segmentation.strength is None:
        return np.ones(len(planes.centre), dtype=np.bool_)
    field, strength = segmentation.field, segmentation.strength
    margin = 2 * float(field.voxel_mm.max())
    ring = (planes.radius + margin)[:, None, None] * (_CIRCLE @ planes.across)
    where = (planes.centre[:, None] + ring - field.origin_mm) / field.voxel_mm
    flat = np.ascontiguousarray(where.reshape(-1, 3))
    around = sample(strength.signal, flat).reshape(where.shape[:2])
    return np.asarray(np.nan_to_num(around).mean(axis=1) > strength.noise)
