"""Serialise the playback of a predicted print as JSON with deflated arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Final

import numpy as np
from matplotlib.colors import LinearSegmentedColormap, to_hex
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray
from registration.gcode_job import Act
from registration.report.gcode.chunks import NO_WIDTH
from registration.report.gcode.colouring import Colouring, usual_span
from registration.report.packing import pack, pack_positions
from registration.report.picture.colours import DIVERGING_ANCHORS, TREE_COLOURS, samples
from registration.report.play.playback import Playback

INK_STEPS: Final = 1_000_000
"""Of all ink: as fine as the page tells how much lies in the bath."""
MOST_OFF: Final = 0.25
"""Of the wanted width, where the scale of the comparison ends."""
# The house's scale with a middle that stands out from a light ground as from a dark one: here most
# of the picture is as wanted, and there is no shading.
OFF: Final = LinearSegmentedColormap.from_list(
    "off", [*DIVERGING_ANCHORS[:3], "#a2b4c0", "#b1b6b9", "#c8b39d", *DIVERGING_ANCHORS[6:]]
)
NOT_HELD: Final = "#998da8"
"""Of lines that nothing says a width of; apart from the middle of `OFF`."""
_MS: Final = 1e-3
_UM: Final = 1e-3
_GAP: Final = 2e-6


def pack_playback(played: Playback) -> dict[str, Any]:
    """All that the page needs, as JSON values.

    A row ends at its place and time, and began where the one before ended. Where it didn't, a row
    of `Act.JUMP` before it says where and when it did. Times are whole ms, widths whole µm, ink
    `INK_STEPS` of all of it; of times, ink, lines and layers the differences are kept.
    """
    rows = played.rows
    at, jumps = _with_jumps(played)
    place = np.where(jumps[:, None], rows.start[at], rows.end[at])
    time = np.where(jumps, rows.begin_s[at], rows.end_s[at])
    laid_before = np.concatenate([[0.0], rows.laid_ul[:-1]])
    laid = np.where(jumps, laid_before[at], rows.laid_ul[at])
    step = max(float(rows.laid_ul.max(initial=0.0)), 1e-9) / INK_STEPS
    ends = np.concatenate([rows.start, rows.end])[np.tile(rows.act == Act.WRITE, 2)]
    half = float(np.nan_to_num(np.nanmax(rows.width_mm, initial=0.0))) / 2
    return {
        "rows": len(at),
        "passes": played.passes,
        "places": pack_positions(place),
        "time_ms": _steps(time / _MS),
        "laid": _steps(laid / step),
        "laid_step_ul": step,
        "line": _steps(rows.line[at]),
        "layer": _steps(rows.layer[at]),
        "vessel": _steps(rows.vessel[at]),
        "head": pack(rows.head[at].astype(np.uint8)),
        "act": pack(np.where(jumps, np.uint8(Act.JUMP), rows.act[at]).astype(np.uint8)),
        "width_um": _widths(np.where(jumps, np.nan, rows.width_mm[at])),
        "wanted_um": _widths(np.where(jumps, np.nan, rows.wanted_mm[at])),
        "layer_z": np.round(played.layer_z_mm, 4).tolist(),
        "low": np.round(ends.min(axis=0) - half, 4).tolist(),
        "high": np.round(ends.max(axis=0) + half, 4).tolist(),
        "inks": list(played.inks),
        "colourings": [
            {**asdict(one), "diverging": one.key == "off"} for one in colourings(played)
        ],
        "scales": {
            "sequential": samples(False),
            "diverging": [to_hex(OFF(k / 32)) for k in range(33)],
        },
        "none": NOT_HELD,
        "wanted": played.wanted,
    }


def colourings(played: Playback) -> list[Colouring]:
    """What lines can be coloured by: only what says something of this job."""
    rows = played.rows
    writes = (rows.act == Act.WRITE) & ~np.isnan(rows.width_mm)
    chosen = []
    if not np.isnan(played.compared[writes]).all():
        limits = (-100 * MOST_OFF, 100 * MOST_OFF)
        chosen.append(Colouring("off", f"Width against {played.wanted}", "%", limits))
    if writes.any():
        limits = usual_span(rows.width_mm[writes], rows.way_mm[writes])
        chosen.append(Colouring("width", "Predicted width", "mm", limits))
    if (rows.vessel >= 0).any():
        chosen.append(Colouring("vessel", "Vessel", "", (0.0, 1.0), (), TREE_COLOURS))
    if len(played.inks) > 1:
        hues = (TREE_COLOURS * len(played.inks))[: len(played.inks)]
        chosen.append(Colouring("head", "Ink", "", (0.0, 1.0), played.inks, hues))
    return chosen


def _with_jumps(played: Playback) -> tuple[IntArray, NDArray[np.bool_]]:
    """Rows with one more before each that doesn't begin where the one before it ended."""
    rows = played.rows
    apart = (np.abs(rows.start[1:] - rows.end[:-1]) > _GAP).any(axis=1)
    apart |= np.abs(rows.begin_s[1:] - rows.end_s[:-1]) > _GAP
    before = np.flatnonzero(np.concatenate([[True], apart]))
    jumps = np.insert(np.zeros(len(rows), bool), before, True)
    return np.insert(np.arange(len(rows)), before, before), jumps


def _steps(values: NDArray[Any] | Sequence[float]) -> str:
    """Whole numbers as differences."""
    whole = np.rint(np.asarray(values, np.float64)).astype(np.int64)
    return pack(np.diff(whole, prepend=0).astype(np.int32))


def _widths(width_mm: FloatArray) -> str:
    um = np.clip(np.rint(np.nan_to_num(width_mm, nan=-1.0) / _UM), -1, NO_WIDTH - 1)
    return pack(np.where(um < 0, NO_WIDTH, um).astype(np.uint16))
