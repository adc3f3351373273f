"""Measure one layer of a scan against its G-code: gel coverage, gaps, and gel inside lumens.

A segmented wall is a blur wide, and a pixel at it may fall on either side. Shares count all seen
pixels; gaps and blobs count only what lies farther than `Limits.edge_mm` from the border between
written and free, so that a wall off by less than that isn't called a defect.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, distance_transform_edt

from kernels.arrays import IntArray
from registration.overlay.cut import ScanCut
from registration.overlay.lines import LayerLines
from registration.overlay.patches import PixelPatch, spots
from registration.overlay.raster import Raster

Mask = NDArray[np.bool_]

LEAST_SHARE, LEAST_PIXELS = 0.02, 9
"""Of a gap; lines that cover less of it than either aren't named."""


@dataclass(frozen=True)
class Limits:
    """Minimum sizes that count in a layer's measures.

    Attributes
    ----------
    edge_mm : float, mm
        Nearer than this to the border between written and free nothing is called a gap or a blob.
    least_mm2, least_width_mm : float, mm², mm
        Smaller or thinner ones are noise.
    """

    edge_mm: float
    least_mm2: float
    least_width_mm: float

    @staticmethod
    def of(line_mm: float, blur_mm: float) -> Limits:
        """Two standard deviations of the blur; a square, and a third, of a line's width."""
        return Limits(2 * blur_mm, line_mm**2, line_mm / 3)


@dataclass(frozen=True, eq=False)
class LayerNumbers:
    """What a scan shows of a layer.

    Attributes
    ----------
    layer : LayerLines
    seen : float
        Share of the written area that is in view and lit.
    in_view : float
        Share of the written area that is in the field of view.
    written_mm2, free_mm2 : float, mm²
        The layer's lines; the design's lumens less the lines.
    gel_in_written, gel_in_free : float or None
        Share of the seen part of each that shows gel; None where nothing of it is seen.
    gaps, blobs : tuple of PixelPatch
        Written and without gel; free and with gel. The largest first.
    gap_lines : tuple of (k,) int64
        Of each gap, the G-code lines whose bands cover it, ascending.
    move_seen, move_gel : (n,) int64
        Seen pixels of each move's band, and those with gel.
    """

    layer: LayerLines
    seen: float
    in_view: float
    written_mm2: float
    free_mm2: float
    gel_in_written: float | None
    gel_in_free: float | None
    gaps: tuple[PixelPatch, ...]
    blobs: tuple[PixelPatch, ...]
    gap_lines: tuple[IntArray, ...]
    move_seen: IntArray
    move_gel: IntArray


def measure_layer(
    layer: LayerLines,
    lumen: Mask,
    cut: ScanCut,
    raster: Raster,
    limits: Limits,
    corrected: bool = False,
) -> LayerNumbers:
    """Hold a cut against its layer.

    Parameters
    ----------
    layer : LayerLines
    lumen : (ny, nx) bool
        Where the design is to be free at the layer's middle.
    cut : ScanCut
        At that height.
    raster : Raster
    limits : Limits
    corrected : bool
        Lumens were written otherwise than they are to become: lines count outside of them only.
    """
    owner = raster.owners(layer)
    if corrected:
        owner[lumen] = -1
    written = owner >= 0
    free = lumen & ~written
    # Between two lines a hair may be left: no border of the material.
    material = binary_closing(np.pad(written, 2), iterations=2)[2:-2, 2:-2] & ~free
    # To the border, not to the middle of the next pixel.
    edge = limits.edge_mm / raster.pixel_mm + 0.5
    deep = distance_transform_edt(material) > edge
    clear = distance_transform_edt(~material) > edge
    least = limits.least_mm2, limits.least_width_mm
    gaps = spots(written & deep & cut.seen & ~cut.gel, raster, *least)
    blobs = spots(free & clear & cut.seen & cut.gel, raster, *least)
    pixel = raster.pixel_mm**2
    return LayerNumbers(
        layer=layer,
        seen=_share(cut.seen, written) or 0.0,
        in_view=_share(cut.in_view, written) or 0.0,
        written_mm2=float(written.sum()) * pixel,
        free_mm2=float(free.sum()) * pixel,
        gel_in_written=_share(cut.gel, written & cut.seen),
        gel_in_free=_share(cut.gel, free & cut.seen),
        gaps=tuple(gaps),
        blobs=tuple(blobs),
        gap_lines=tuple(_lines(owner[gap.box][gap.mask], layer.line) for gap in gaps),
        move_seen=_count(owner, written & cut.seen, layer),
        move_gel=_count(owner, written & cut.seen & cut.gel, layer),
    )


def _share(what: Mask, of: Mask) -> float | None:
    return float(what[of].mean()) if of.any() else None


def _count(owner: NDArray[np.int32], where: Mask, layer: LayerLines) -> IntArray:
    return np.bincount(owner[where], minlength=len(layer.line)).astype(np.int64)


def _lines(owner: NDArray[np.int32], line: IntArray) -> IntArray:
    """Lines that cover more than a corner of the gap, ascending."""
    numbers, count = np.unique(line[owner], return_counts=True)
    return np.asarray(numbers[count >= min(LEAST_SHARE * len(owner), LEAST_PIXELS)])
