"""Serialise the playback of a predicted print as JSON with deflated arrays."""

from __future__ import annotations

from dataclasses import asdict
from typing import Final

import numpy as np
from matplotlib.colors import LinearSegmentedColormap, to_hex
from numpy.typing import NDArray

from kernels.arrays import IntArray
from registration.gcode_job import Act
from report.gcode.chunks import NO_WIDTH
from report.gcode.colouring import Colouring, width_colouring
from report.packing import PackedColumn, pack_table
from report.picture.colours import DIVERGING_ANCHORS, TREE_COLOURS, samples
from report.play.playback import Playback

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
COLUMNS: Final = (
    *(PackedColumn(axis, "i4", 1e-4, summed=True) for axis in "xyz"),
    PackedColumn("time", "i4", 1e-3, summed=True),
    PackedColumn("line", "i4", summed=True),
    PackedColumn("layer", "i4", summed=True),
    PackedColumn("vessel", "i4", summed=True),
    PackedColumn("head", "u1"),
    PackedColumn("planned", "u1"),
    PackedColumn("width", "u2", 1e-3, none=NO_WIDTH),
    PackedColumn("wanted", "u2", 1e-3, none=NO_WIDTH),
)
"""Of a row: mm, and time in s."""
_GAP: Final = 2e-6


def pack_playback(played: Playback) -> dict[str, object]:
    """All that the page needs, as JSON values.

    A row ends at its place and time, and began where the one before ended. Where it didn't, a row
    of `Act.JUMP` before it says where and when it did. Ink is kept in
    `INK_STEPS` of all of it, the rest as `COLUMNS`.
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
    values = {
        **{axis: place[:, k] for k, axis in enumerate("xyz")},
        "time": time,
        "laid": laid,
        "planned": np.where(jumps, np.uint8(Act.JUMP), rows.act[at]),
        "width": np.where(jumps, np.nan, rows.width_mm[at]),
        "wanted": np.where(jumps, np.nan, rows.wanted_mm[at]),
        **{name: getattr(rows, name)[at] for name in ("line", "layer", "vessel", "head")},
    }
    columns = [*COLUMNS, PackedColumn("laid", "i4", step, summed=True)]
    return {
        "passes": played.passes,
        "rows": pack_table(columns, values),
        "layer_z": np.round(played.layer_z_mm, 4).tolist(),
        "low": np.round(ends.min(axis=0) - half, 4).tolist(),
        "high": np.round(ends.max(axis=0) + half, 4).tolist(),
        "inks": list(played.inks),
        "colourings": [asdict(one) for one in colourings(played)],
        "colours": {
            "sequential": samples(False),
            "diverging": [to_hex(OFF(k / 32)) for k in range(33)],
            "none": NOT_HELD,
        },
    }


def colourings(played: Playback) -> list[Colouring]:
    """What lines can be coloured by: only what says something of this job."""
    rows = played.rows
    writes = (rows.act == Act.WRITE) & ~np.isnan(rows.width_mm)
    chosen = []
    off = 100 * played.compared[writes]
    if not np.isnan(off).all():
        limits = (-100 * MOST_OFF, 100 * MOST_OFF)
        extremes = float(np.nanmin(off)), float(np.nanmax(off))
        name = f"Width against {played.wanted}"
        chosen.append(Colouring("off", name, "%", limits, scale="diverging", extremes=extremes))
    if writes.any():
        widths = rows.width_mm[writes]
        chosen.append(width_colouring("Predicted width", widths, rows.way_mm[writes]))
    if (rows.vessel >= 0).any():
        chosen.append(Colouring("vessel", "Vessel", "", (0.0, 1.0), (), TREE_COLOURS, "names"))
    if len(played.inks) > 1:
        hues = (TREE_COLOURS * len(played.inks))[: len(played.inks)]
        chosen.append(Colouring("head", "Ink", "", (0.0, 1.0), played.inks, hues, "names"))
    return chosen


def _with_jumps(played: Playback) -> tuple[IntArray, NDArray[np.bool_]]:
    """Rows with one more before each that doesn't begin where the one before it ended."""
    rows = played.rows
    apart = (np.abs(rows.start[1:] - rows.end[:-1]) > _GAP).any(axis=1)
    apart |= np.abs(rows.begin_s[1:] - rows.end_s[:-1]) > _GAP
    before = np.flatnonzero(np.concatenate([[True], apart]))
    jumps = np.insert(np.zeros(len(rows), bool), before, True)
    return np.insert(np.arange(len(rows)), before, before), jumps
