"""Draw an observed print's inspections for the report: strip of pictures, plot of ink seen."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from PIL import Image, ImageDraw, ImageFont

from printctl.machine.job.job import Insert
from printctl.machine.records.record import JOURNAL
from printctl.machine.records.replay import read_journal, read_journal_if_any
from printctl.observe.records import LookRecord, look_picture, read_looks
from report.figures.look_figure import LookRow, look_figure

_MOST: Final = 96
_COLUMNS: Final = 8
_WIDTH_PX: Final = 1280
_SIDE_PX: Final = 150
_EDGE_PX: Final = 4
_COLOURS: Final = 96
_PLAIN, _WRITTEN, _HELD = "#5f6972", "#1b5e9e", "#ad3517"
_CURVE: Final = (
    "Share of the written way that was seen with ink, by look, before its mend; mends, "
    "corrections of the flow and pauses are marked"
)
_SCANNED: Final = "; diamonds: share of the same lines that the final scan has, after all mends"


def look_pictures(
    print_folder: Path, scan_rows: Sequence[Mapping[str, Any]] = ()
) -> dict[str, bytes]:
    """Draw what the looks at a print have told, for the report's section Print.

    Parameters
    ----------
    print_folder : Path
        With the journal; looks of an earlier print in it are left out.
    scan_rows : sequence of dict
        What the final scan has where they looked (`printctl.pipeline.judging.written_in_scan`).

    Returns
    -------
    dict of caption to PNG and SVG
        Empty for a print that nobody observed.
    """
    looks = read_looks(print_folder, read_journal_if_any(print_folder / JOURNAL).started)
    if not looks:
        return {}
    scanned = {row["look"]: _share(row["scan_ink"]) for row in scan_rows}
    rows = [
        replace(row, scan=scanned.get(row.number, math.nan))
        for row in look_rows(looks, read_journal(print_folder / JOURNAL).inserts)
    ]
    shown = chosen_looks(rows, _MOST)
    strip = _strip(print_folder, [rows[k] for k in shown])
    count = (
        f"{len(looks)} looks" if len(shown) == len(looks) else f"{len(shown)} of {len(looks)} looks"
    )
    caption = (
        f"print/{count} in their order, each with the share that had ink: blue mended or flow "
        "corrected, red paused or cancelled"
    )
    curve = f"print/{_CURVE}{_SCANNED if scan_rows else ''}"
    return {curve: look_figure(rows), caption: strip}


def look_rows(looks: Sequence[LookRecord], inserts: Sequence[Insert]) -> list[LookRow]:
    """Return each look with what the journal says was done after it."""
    done = {one.look: one for one in inserts}
    rows, flow = [], 1.0
    for look in looks:
        insert = done.get(look.number)
        changed = insert is not None and insert.flow != flow
        flow = insert.flow if insert is not None else flow
        rows.append(
            LookRow(
                look.number,
                _share(look.found.get("coverage")),
                _share(look.found.get("seen_share")),
                mended=insert is not None and len(insert.lines) > 0,
                flow=flow if changed else None,
                held=insert is None and look.decision in ("pause", "stop"),
            )
        )
    return rows


def chosen_looks(rows: Sequence[LookRow], most: int) -> list[int]:
    """Return which looks a strip shows: those that acted first, of the others evenly spread."""
    acted = [k for k, row in enumerate(rows) if row.mended or row.held or row.flow is not None]
    plain = sorted(set(range(len(rows))) - set(acted))
    kept = _spread(acted, most)
    return sorted([*kept, *_spread(plain, most - len(kept))])


def _spread(these: list[int], most: int) -> list[int]:
    if len(these) <= most:
        return these
    return [these[round(k * (len(these) - 1) / max(most - 1, 1))] for k in range(most)]


def _share(value: Any) -> float:
    return math.nan if value is None else float(value)


def _strip(print_folder: Path, rows: Sequence[LookRow]) -> bytes:
    """Small pictures row by row, each with its number and share, framed by what was done."""
    down = -(-len(rows) // _COLUMNS)
    columns = -(-len(rows) // down)  # rows alike, so that few cells stay empty
    side = max(_SIDE_PX, _WIDTH_PX // max(columns, 4))
    sheet = Image.new("RGB", (columns * side, down * side), "#dcdfe2")
    for k, row in enumerate(rows):
        sheet.paste(_cell(print_folder, row, side), (k % columns * side, k // columns * side))
    out = io.BytesIO()
    sheet.quantize(_COLOURS, dither=Image.Dither.NONE).save(out, "PNG", optimize=True)
    return out.getvalue()


def _cell(print_folder: Path, row: LookRow, side: int) -> Image.Image:
    colour = _HELD if row.held else _WRITTEN if row.mended or row.flow is not None else _PLAIN
    cell = Image.new("RGB", (side, side), colour)
    inner = side - 2 * _EDGE_PX
    picture = _small(look_picture(print_folder, row.number), inner)
    at = [(side - size) // 2 for size in picture.size]
    cell.paste(picture, (at[0], at[1]))
    pen = ImageDraw.Draw(cell)
    words = f"{row.number}" if math.isnan(row.ink) else f"{row.number}: {row.ink:.1%}"
    font = ImageFont.load_default(16)
    wide = pen.textlength(words, font=font)
    pen.rectangle((0, 0, wide + 12, 24), fill=colour)
    pen.text((6, 3), words, fill="white", font=font)
    return cell


def _small(path: Path | None, side: int) -> Image.Image:
    """A picture that fits into a square; an empty one where there is none that can be read."""
    if path is not None:
        try:
            with Image.open(path) as seen:
                picture = seen.convert("RGB")
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
            pass
        else:
            picture.thumbnail((side, side), Image.Resampling.LANCZOS, reducing_gap=2.0)
            return picture
    return Image.new("RGB", (side, side), "#fcfcfb")
