"""Segment any scan (OCT, micro-CT, confocal): choose the method, return the gel surface mesh.

OCT: bin, take the noise floor off, compensate attenuation (Vermeer 2014; beside walls with the
gel's light), smooth, and the surface halfway between the local levels of liquid and gel, which
takes roll-off and the rest of the compensation's error away. Micro-CT and confocal: bin, smooth,
the surface halfway between the modes of gel and lumen.

Not done yet: roll-off from the instrument's file, shadows of absorbers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from design.geometry.surface import Surface
from kernels.arrays import FloatArray
from registration.errors import SegmentationError
from registration.scan import Scan
from registration.segmentation.levels import plain_field
from registration.segmentation.mesh import surface_mesh
from registration.segmentation.oct_field import oct_field
from registration.segmentation.volume import GelField, Strength
from registration.segmentation.working import Working


@dataclass(frozen=True)
class SegmentationOptions:
    """Options of a segmentation.

    Attributes
    ----------
    working_voxel_mm : float, mm
        Voxels are averaged to about this edge; an eighth of the thinnest lumen is right, in OCT
        a twelfth.
    smoothing_mm : float or None, mm
        Standard deviation of the Gaussian; None takes 0.8 of `working_voxel_mm`, or in OCT of the
        scan's own coarsest voxel.
    lumens : "dark" or "bright"
        Against the gel; "bright" when filled with contrast agent.
    wall_mm : float, mm
        How much further into the gel this instrument's walls truly lie (`wall_reference`).
    whole_part : bool
        Whether micro-CT or confocal shows the part's outside, not only lumens in gel.
    speck_mm : float, mm
        Closed surfaces with a box diagonal below this are noise.
    """

    working_voxel_mm: float = 0.05
    smoothing_mm: float | None = None
    lumens: Literal["dark", "bright"] = "dark"
    wall_mm: float = 0.0
    whole_part: bool = False
    speck_mm: float = 0.5


@dataclass(frozen=True)
class Segmentation:
    """The scanned surface, in the scan's frame.

    Attributes
    ----------
    field : GelField
        The volume it was taken from.
    surface : Surface
        Its triangles face out of the gel.
    outward : (n, 3) float64
        Unit normals, out of the gel.
    seen : (n,) bool
        Where light came back from the gel beside the surface, and the field's edge is far.
    contrast : float
        Distance of the two classes over the spread of the gel.
    strength : Strength or None
        None where no light measured, and all of the field is seen.
    """

    field: GelField
    surface: Surface
    outward: FloatArray
    seen: NDArray[np.bool_]
    contrast: float
    strength: Strength | None


def segment(scan: Scan, options: SegmentationOptions | None = None) -> Segmentation:
    """Find the surface between gel and lumen (or liquid) in a scan.

    Raises
    ------
    SegmentationError
        When the volume is empty, saturated, not finite or without contrast.
    """
    options = options or SegmentationOptions()
    _check_volume(scan)
    if scan.modality == "oct" and options.lumens == "bright":
        raise SegmentationError(
            "the lumens are said to be filled with something brighter than gel, which is read of "
            "micro-CT and confocal scans alone: what scatters more than gel looks like gel to OCT, "
            "and shades what lies below; fill the lumens with clear liquid and scan again"
        )
    smoothing = options.smoothing_mm or 0.8 * _fineness(scan, options)
    working = Working.of(scan, options.working_voxel_mm, smoothing)
    strength: Strength | None = None
    if scan.modality == "oct":
        field, contrast, strength = oct_field(scan, working)
    else:
        field, contrast = plain_field(scan, working, options.lumens, whole_part=options.whole_part)
    surface, outward, seen = surface_mesh(field, strength, options.speck_mm)
    wall_mm = options.wall_mm + field.faint_mm
    moved = wall_mm + field.facing_mm * outward[:, 2:] ** 2
    surface = replace(surface, vertices=surface.vertices - moved * outward)
    field = replace(field, wall_mm=wall_mm)
    return Segmentation(field, surface, outward, seen, contrast, strength)


def _fineness(scan: Scan, options: SegmentationOptions) -> float:
    """What smoothing goes by, mm: speckle has the size of a voxel, however fine the work."""
    own = scan.geometric_voxel_mm if scan.modality == "oct" else ()
    return max((options.working_voxel_mm, *own))


def _check_volume(scan: Scan) -> None:
    volume = scan.volume
    if volume.ndim != 3 or min(volume.shape) < 8:
        raise SegmentationError(
            f"volume of shape {volume.shape} isn't a stack of at least 8 voxels each way"
        )
    probe = volume[:: max(1, volume.shape[0] // 64), ::4, ::4]
    if not np.issubdtype(volume.dtype, np.integer) and not np.isfinite(probe).all():
        raise SegmentationError("the volume holds NaN or infinite values; export it again")
    low, high = probe.min(), probe.max()
    if low == high:
        raise SegmentationError(f"the volume is empty: every sampled voxel is {low}")
    if ((probe == low) | (probe == high)).all():
        raise SegmentationError(
            f"the volume holds two values only, {low} and {high}: it is a segmented image, and "
            "walls are placed by grey values; give the scan as it was before that"
        )
    clipped = float((probe == high).mean())
    if clipped > 0.05 and np.issubdtype(volume.dtype, np.integer) and scan.counts is None:
        raise SegmentationError(
            f"the volume is saturated: {100 * clipped:.0f} % of its voxels hold the largest "
            f"value {high} (limit 5 %); scan again with less power or gain"
        )
