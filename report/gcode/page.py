"""Write the offline HTML page of a G-code file: layers to scale, travels, design outlines."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.files import write_text
from registration.gcode_job import Act, GcodeJob, layer_sums
from report.errors import ReportError
from report.gcode.chunks import COLUMNS, PackedPieces, pack_job
from report.gcode.colouring import PLAIN, colourings
from report.gcode.outline_pack import MAX_POINTS, PackedOutlines, pack_outlines
from report.gcode.part_outline import DesignOutline
from report.page_frame import page_colours, render
from report.wording import count, number

MAX_MOVES: Final = 12_000_000
"""Moves of a page at most: about 200 MB."""
MAX_TEXT_BYTES: Final = 120_000_000
"""Of a file whose lines go into the page; of a larger one only their numbers do."""

GCODE_STATIC: Final = Path(__file__).parent / "static"
"""The page's script and style sheet, which `report.play` takes too."""
_ENTRY: Final = 'import "gcode/main";'


@dataclass(frozen=True)
class GcodePage:
    """Options of a G-code page.

    Attributes
    ----------
    colour : str
        Key of a colouring, a `GcodeColour`.
    layer : int
        From 0.
    """

    colour: str
    layer: int = 0


def write_gcode_html(
    path: Path,
    job: GcodeJob,
    page: GcodePage,
    outlines: Iterable[DesignOutline] | None = None,
) -> None:
    """Write a job as one HTML file that opens offline.

    Parameters
    ----------
    path : Path
        The file; an old one is replaced only by a whole new one.
    job : GcodeJob
    page : GcodePage
    outlines : iterable of DesignOutline, optional
        The design's in each layer, lowest first: drawn over the lines.

    Raises
    ------
    ReportError
        When it has more than `MAX_MOVES` moves.
    OSError
        When the file can't be written.
    """
    if len(job) > MAX_MOVES:
        raise ReportError(
            f"{job.name} has {len(job)} moves, and a page holds {MAX_MOVES} at most; show some "
            "of its layers (printctl view --layers 1:100)"
        )
    with_text = len(job.text) <= MAX_TEXT_BYTES
    packed = pack_job(job, with_text)
    drawn = None if outlines is None else pack_outlines(outlines)
    context = {
        "title": job.name,
        "facts": _facts(job),
        "notes": [*job.notes, *_left_out(job, with_text), *_of_outlines(outlines, drawn)],
        "view": _view(job, packed, page) | ({"outline": drawn.view} if drawn else {}),
        "outlines": drawn.data if drawn else [],
        "chunks": packed.chunks,
        "noun": "Pass" if job.layers.passes else "Layer",
    }
    write_text(path, render("gcode.html", context, _ENTRY, [GCODE_STATIC / "gcode.css"]))


def _view(job: GcodeJob, packed: PackedPieces, page: GcodePage) -> dict[str, object]:
    """All but the moves, as JSON values."""
    sums, writes = layer_sums(job), job.writes
    half = np.nan_to_num(np.nanmax(job.width_mm[writes], initial=0.0)) / 2
    ends = np.concatenate([job.start[writes], job.end[writes]])
    table = {
        "z": job.layers.z_mm,
        "height": job.layers.height_mm,
        "chunk": packed.chunk,
        "from": packed.first,
        "to": packed.last,
        **sums,
    }
    return {
        "passes": job.layers.passes,
        "layers": {key: _values(column) for key, column in table.items()},
        "rows": [chunk.rows for chunk in packed.chunks],
        "low": _values(ends.min(axis=0) - half),
        "high": _values(ends.max(axis=0) + half),
        "colourings": [asdict(each) for each in [*colourings(job), PLAIN]],
        "colours": page_colours(),
        "columns": [asdict(one) for one in COLUMNS],
        "kinds": list(job.kinds),
        "vessels": job.vessel is not None,
        "first": {"layer": page.layer, "colour": page.colour},
    }


def _values(column: NDArray[Any]) -> list[Any]:
    """As JSON: null for what isn't known, nothing finer than a nanometre."""
    if column.dtype.kind != "f":
        return column.tolist()
    return [None if np.isnan(x) else round(x, 6) for x in column.tolist()]


def _facts(job: GcodeJob) -> list[str]:
    """A few numbers for the top of the page."""
    writes = job.writes
    written = float(job.dose_ul[writes].sum())
    minutes = float(job.time_s.sum()) / 60.0
    time = f"{number(minutes, 3)} min" if minutes < 120 else f"{number(minutes / 60, 3)} h"
    noun = ("pass", "passes") if job.layers.passes else ("layer", "layers")
    way = float(job.way_mm[writes].sum())
    moves, lines = int((job.act != Act.JUMP).sum()), len(job.text.splitlines())
    arcs = " (arcs in pieces)" if moves > lines else ""
    return [
        count(len(job.layers), *noun),
        f"{count(moves, 'move')}{arcs} in {count(lines, 'line')}",
        *([f"{number(written, 4)} µL written"] if np.isfinite(written) else []),
        f"{number(way / 1e3, 4)} m written",
        f"{time} as fed",
    ]


def _of_outlines(asked: Iterable[DesignOutline] | None, drawn: PackedOutlines | None) -> list[str]:
    """What the outline's colours mean, or why there is none."""
    if asked is None:
        return []
    if drawn is None:
        return [
            f"The design's outline has more than {MAX_POINTS} points in all layers and is left "
            "out; show single layers (printctl view --png --layer)."
        ]
    return [
        "The outline is the section of the design at the middle of each layer. Blue: ink falls "
        "short of it, and a lumen is wider there; orange: ink lies beyond it, into a lumen or out "
        "of the part. On slanted walls some blue is meant: lines keep clear of the lumen above and "
        "below the section."
    ]


def _left_out(job: GcodeJob, with_text: bool) -> list[str]:
    if with_text:
        return []
    return [
        f"The file has {len(job.text) / 1e6:.0f} MB, and only up to {MAX_TEXT_BYTES / 1e6:.0f} MB "
        "go into a page with their text: lines are told by number."
    ]
