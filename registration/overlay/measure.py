"""Measure each layer of a scan against its G-code: coverage, gaps, status."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, NotRequired, TypedDict

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, distance_transform_edt

from kernels.arrays import BoolArray, IntArray
from registration.overlay.cut import ScanCut
from registration.overlay.raster import LayerLines, PixelPatch, Raster, spots

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
    lumen: BoolArray,
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


def _share(what: BoolArray, of: BoolArray) -> float | None:
    return float(what[of].mean()) if of.any() else None


def _count(owner: NDArray[np.int32], where: BoolArray, layer: LayerLines) -> IntArray:
    return np.bincount(owner[where], minlength=len(layer.line)).astype(np.int64)


def _lines(owner: NDArray[np.int32], line: IntArray) -> IntArray:
    """Lines that cover more than a corner of the gap, ascending."""
    numbers, count = np.unique(line[owner], return_counts=True)
    return np.asarray(numbers[count >= min(LEAST_SHARE * len(owner), LEAST_PIXELS)])


LEAST_SEEN: Final = 0.1
"""Of the written area; of a layer of which less is seen nothing is said."""
MOSTLY_SEEN: Final = 0.9
AGREED: Final = 0.95
"""Of the seen written area of a layer under way: gel before its last line, none behind."""
LEAST_REST: Final = 0.03
"""Of a layer's seen written area; a rest smaller than this isn't told from a gap."""
LEAST_GEL: Final = 0.1
"""Of the seen written area; a layer that shows less isn't there."""


class LayerStatus(StrEnum):
    """Of one layer in one scan."""

    PRINTED = "printed"
    PARTLY_SEEN = "partly seen"
    """Gel is there, and part of the layer is out of view or unlit."""
    UNDER_WAY = "under way"
    """The topmost with gel, written up to one of its lines and without gel from there on."""
    NOT_SEEN = "not seen"
    """Out of view or unlit: neither there nor missing."""
    NOT_PRINTED = "not printed"
    """In view and no gel, nor any above it: not yet printed when it was scanned."""
    MISSING = "missing"
    """In view and no gel, although layers above it have some."""

    @property
    def judged(self) -> bool:
        """Whether its gaps and blobs mean anything."""
        return self not in (LayerStatus.NOT_SEEN, LayerStatus.NOT_PRINTED)


def statuses(numbers: Sequence[LayerNumbers]) -> list[LayerStatus]:
    """Of all layers of a job, the lowest first."""
    layers = []
    gel_above = False
    for one in reversed(numbers):
        status = _status(one, gel_above)
        gel_above |= status in (LayerStatus.PRINTED, LayerStatus.PARTLY_SEEN)
        layers.append(status)
    return layers[::-1]


def _status(one: LayerNumbers, gel_above: bool) -> LayerStatus:
    if one.seen < LEAST_SEEN or one.gel_in_written is None:
        return LayerStatus.NOT_SEEN
    if one.gel_in_written < LEAST_GEL:
        return LayerStatus.MISSING if gel_above else LayerStatus.NOT_PRINTED
    return LayerStatus.PRINTED if one.seen >= MOSTLY_SEEN else LayerStatus.PARTLY_SEEN


def reached(one: LayerNumbers) -> int | None:
    """How many of a layer's moves were made when it was scanned, if it broke off.

    The count that fits best: gel in all bands before it, none from there on. None where the whole
    layer was written, or where gel and no gel don't follow the order of writing (gaps do not).
    """
    seen, gel = one.move_seen, one.move_gel
    before = np.concatenate([[0], np.cumsum(gel)])
    behind = np.concatenate([[0], np.cumsum(seen - gel)])
    right = before + behind[-1] - behind
    count = int(np.argmax(right))
    total, rest = int(seen.sum()), int(seen[count:].sum())
    if total == 0 or right[count] < AGREED * total or rest < LEAST_REST * total:
        return None
    return count or None


class OverlaySpot(TypedDict):
    """A gap or a blob in overlay.json; of a gap with the G-code lines that cover it."""

    area_mm2: float
    width_um: float
    at_mm: list[float]
    from_mm: list[float]
    to_mm: list[float]
    lines: NotRequired[list[int]]
    line_count: NotRequired[int]
    first_line: NotRequired[int]
    last_line: NotRequired[int]


class OverlayLayer(TypedDict):
    """A layer in overlay.json; what isn't known is None."""

    layer: int
    from_mm: float
    to_mm: float
    cut_mm: float
    status: str
    first_line: int
    last_line: int
    in_view_share: float
    seen_share: float
    written_mm2: float
    free_mm2: float
    gel_in_written_share: float | None
    gel_in_free_share: float | None
    gap_count: int | None
    gap_mm2: float | None
    gaps: list[OverlaySpot] | None
    blob_count: int | None
    blob_mm2: float | None
    blobs: list[OverlaySpot] | None


MOST_LINES: Final = 20
"""Of a gap, that are named one by one."""
MOST_SPOTS: Final = 20
"""Of a layer, that are listed one by one."""


def overlay_dict(numbers: LayerNumbers, status: LayerStatus) -> OverlayLayer:
    """One layer's numbers, JSON-ready; what isn't known is None.

    Of a layer that isn't judged gaps and blobs are None: it is neither good nor bad.
    """
    layer = numbers.layer
    judged, unseen = status.judged, status == LayerStatus.NOT_SEEN
    gaps = [
        _named(_spot(gap, layer.middle_mm), lines.tolist())
        for gap, lines in zip(numbers.gaps, numbers.gap_lines, strict=True)
    ]
    blobs = [_spot(blob, layer.middle_mm) for blob in numbers.blobs]
    return {
        "layer": layer.number,
        "from_mm": round(layer.low_mm, 6),
        "to_mm": round(layer.high_mm, 6),
        "cut_mm": round(layer.middle_mm, 6),
        "status": str(status),
        "first_line": int(layer.line[0]),
        "last_line": int(layer.line[-1]),
        "in_view_share": numbers.in_view,
        "seen_share": numbers.seen,
        "written_mm2": numbers.written_mm2,
        "free_mm2": numbers.free_mm2,
        "gel_in_written_share": None if unseen else numbers.gel_in_written,
        "gel_in_free_share": numbers.gel_in_free if judged else None,
        "gap_count": len(gaps) if judged else None,
        "gap_mm2": sum(gap.area_mm2 for gap in numbers.gaps) if judged else None,
        "gaps": gaps[:MOST_SPOTS] if judged else None,
        "blob_count": len(blobs) if judged else None,
        "blob_mm2": sum(blob.area_mm2 for blob in numbers.blobs) if judged else None,
        "blobs": blobs[:MOST_SPOTS] if judged else None,
    }


def _spot(spot: PixelPatch, height_mm: float) -> OverlaySpot:
    return {
        "area_mm2": spot.area_mm2,
        "width_um": 1e3 * spot.width_mm,
        "at_mm": [round(v, 4) for v in (*spot.at_mm, height_mm)],
        "from_mm": [round(v, 4) for v in spot.low_mm],
        "to_mm": [round(v, 4) for v in spot.high_mm],
    }


def _named(gap: OverlaySpot, lines: list[int]) -> OverlaySpot:
    return {
        **gap,
        "lines": lines[:MOST_LINES],
        "line_count": len(lines),
        "first_line": lines[0],
        "last_line": lines[-1],
    }


_COLUMNS: Final = tuple(
    name for name in OverlayLayer.__annotations__ if name not in ("gaps", "blobs")
)
_LARGEST: Final = ("x_mm", "y_mm", "area_mm2", "width_um")


def overlay_csv(layers: Sequence[OverlayLayer]) -> str:
    """One row a layer of `overlay_dict`, with the largest gap and blob; empty where unknown."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    of_gap = [f"largest_gap_{name}" for name in _LARGEST]
    of_blob = [f"largest_blob_{name}" for name in _LARGEST]
    writer.writerow([*_COLUMNS, *of_gap, "largest_gap_lines", *of_blob])
    for one in layers:
        gap, blob = (next(iter(spots or []), None) for spots in (one["gaps"], one["blobs"]))
        named = " ".join(map(str, gap["lines"])) if gap else ""
        plain = [_cell(value) for name, value in one.items() if name in _COLUMNS]
        writer.writerow([*plain, *_row(gap), named, *_row(blob)])
    return stream.getvalue()


def _row(spot: OverlaySpot | None) -> list[str]:
    if spot is None:
        return [""] * len(_LARGEST)
    return [_cell(v) for v in (*spot["at_mm"][:2], spot["area_mm2"], spot["width_um"])]


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
