"""Convert a scan overlay's results by layer to JSON values and CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any, Final

from registration.overlay.measure import LayerNumbers
from registration.overlay.patches import PixelPatch
from registration.overlay.status import LayerStatus

MOST_LINES: Final = 20
"""Of a gap, that are named one by one."""
MOST_SPOTS: Final = 20
"""Of a layer, that are listed one by one."""


def overlay_dict(numbers: LayerNumbers, status: LayerStatus) -> dict[str, Any]:
    """One layer's numbers, JSON-ready; what isn't known is None.

    Of a layer that isn't judged gaps and blobs are None: it is neither good nor bad.
    """
    layer = numbers.layer
    judged, unseen = status.judged, status == LayerStatus.NOT_SEEN
    gaps = [
        {**_spot(gap, layer.middle_mm), **_named(lines.tolist())}
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


def _spot(spot: PixelPatch, height_mm: float) -> dict[str, Any]:
    return {
        "area_mm2": spot.area_mm2,
        "width_um": 1e3 * spot.width_mm,
        "at_mm": [round(v, 4) for v in (*spot.at_mm, height_mm)],
        "from_mm": [round(v, 4) for v in spot.low_mm],
        "to_mm": [round(v, 4) for v in spot.high_mm],
    }


def _named(lines: list[int]) -> dict[str, Any]:
    return {
        "lines": lines[:MOST_LINES],
        "line_count": len(lines),
        "first_line": lines[0],
        "last_line": lines[-1],
    }


_COLUMNS: Final = (
    "layer", "from_mm", "to_mm", "cut_mm", "status", "first_line", "last_line", "in_view_share",
    "seen_share", "written_mm2", "free_mm2", "gel_in_written_share", "gel_in_free_share",
    "gap_count", "gap_mm2", "blob_count", "blob_mm2",
)  # fmt: skip
_LARGEST: Final = ("x_mm", "y_mm", "area_mm2", "width_um")


def overlay_csv(layers: Sequence[dict[str, Any]]) -> str:
    """One row a layer of `overlay_dict`, with the largest gap and blob; empty where unknown."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    of_gap = [f"largest_gap_{name}" for name in _LARGEST]
    of_blob = [f"largest_blob_{name}" for name in _LARGEST]
    writer.writerow([*_COLUMNS, *of_gap, "largest_gap_lines", *of_blob])
    for one in layers:
        gap, blob = (next(iter(one[name] or []), None) for name in ("gaps", "blobs"))
        named = " ".join(map(str, gap["lines"])) if gap else ""
        writer.writerow([*(_cell(one[name]) for name in _COLUMNS), *_row(gap), named, *_row(blob)])
    return stream.getvalue()


def _row(spot: dict[str, Any] | None) -> list[str]:
    if spot is None:
        return [""] * len(_LARGEST)
    return [_cell(v) for v in (*spot["at_mm"][:2], spot["area_mm2"], spot["width_um"])]


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
