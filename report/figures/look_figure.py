"""Figures of a print watched by camera: strip of its pictures, and share of its lines with ink."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.ticker import MaxNLocator
from PIL import Image, ImageDraw, ImageFont

from report.drawing import blank, styled, to_svg
from report.svg import ACCENT, BAD, INK, MUTED

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


@dataclass(frozen=True)
class LookRow:
    """One look of an observed print.

    Attributes
    ----------
    number : int
        From 1.
    ink : float
        Share of the way that was seen with ink on it, before any mend; NaN where nothing was seen.
    seen : float
        Share of the way written since the look before that could be judged; NaN for no picture.
    mended : bool
        Whether missing ink was written again after it.
    flow : float or None
        Flow factor that was put in force after it; None where it stayed.
    held : bool
        Whether the print was paused or stopped by it, and nothing was written.
    picture : Path or None
        With what was found drawn in.
    scan : float or None
        Share of the same way on which the final scan has ink; NaN where it can't tell; None where
        no scan was held against the looks.
    """

    number: int
    ink: float
    seen: float
    mended: bool = False
    flow: float | None = None
    held: bool = False
    picture: Path | None = None
    scan: float | None = None


def look_figures(rows: Sequence[LookRow]) -> dict[str, bytes]:
    """Draw what the looks at a print have told: a curve (SVG) and a strip of pictures (PNG).

    Returns
    -------
    dict of name to picture
        Empty for a print that nobody observed.
    """
    if not rows:
        return {}
    shown = chosen_looks(rows, _MOST)
    few = f"{len(shown)} of " if len(shown) < len(rows) else ""
    caption = (
        f"print/{few}{len(rows)} looks in their order, each with the share that had ink: blue "
        "mended or flow corrected, red paused or cancelled"
    )
    scanned = any(row.scan is not None for row in rows)
    curve = f"print/{_CURVE}{_SCANNED if scanned else ''}"
    return {curve: look_figure(rows), caption: _strip([rows[k] for k in shown])}


def look_figure(rows: Sequence[LookRow]) -> bytes:
    """Share of the written way seen with ink, by look; mends, flow corrections and pauses marked.

    Parameters
    ----------
    rows : sequence of LookRow
        One at least, in their order.

    Returns
    -------
    bytes
        SVG.
    """
    number = np.array([row.number for row in rows])
    ink = 100.0 * np.array([row.ink for row in rows])
    seen = 100.0 * np.array([row.seen for row in rows])
    scan = 100.0 * np.array([math.nan if row.scan is None else row.scan for row in rows])
    low = np.nanmin([*ink, *seen, *scan, 100.0])
    floor = low - 0.12 * (100.0 - low) - 2.0
    with styled():
        figure, axes = blank(7.2, 3.1)
        axes.plot(number, seen, color=MUTED, linewidth=0.8, linestyle=":", label="could be judged")
        axes.plot(
            number, ink, color=ACCENT, linewidth=1.1, marker="o", markersize=3.0, label="with ink"
        )
        if np.isfinite(scan).any():
            label = "with ink in the final scan"
            axes.plot(number, scan, "D--", color=INK, linewidth=0.9, markersize=3.0, label=label)
        mended = np.array([row.mended for row in rows])
        held = np.array([row.held for row in rows])
        marks: Any = {"linestyle": "", "markersize": 8.0, "markerfacecolor": "none"}
        # What wasn't seen has a place all the same: on the floor.
        place = np.where(np.isfinite(ink), ink, floor)
        if mended.any():
            axes.plot(number[mended], place[mended], "^", color=INK, label="mended", **marks)
        if held.any():
            axes.plot(
                number[held], place[held], "s", color=BAD, label="paused or cancelled", **marks
            )
        _mark_flows(axes, rows)
        axes.set(xlabel="look", ylabel="share of the written way / %")
        axes.set(xlim=(number[0] - 0.5, number[-1] + 0.5), ylim=(floor, 101.5))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
        return to_svg(figure, "looks")


def _mark_flows(axes: Any, rows: Sequence[LookRow]) -> None:
    """A line from each correction of the flow on, with its factor."""
    label: str | None = "flow corrected, to factor"
    for row in rows:
        if row.flow is None:
            continue
        axes.axvline(row.number, color=MUTED, linewidth=0.7, linestyle="--", label=label)
        label = None
        axes.annotate(
            f"{row.flow:.2f}",
            (row.number, 0.02),
            (2, 0),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            color=MUTED,
            fontsize=7.5,
        )


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


def _strip(rows: Sequence[LookRow]) -> bytes:
    """Small pictures row by row, each with its number and share, framed by what was done."""
    down = -(-len(rows) // _COLUMNS)
    columns = -(-len(rows) // down)  # rows alike, so that few cells stay empty
    side = max(_SIDE_PX, _WIDTH_PX // max(columns, 4))
    sheet = Image.new("RGB", (columns * side, down * side), "#dcdfe2")
    for k, row in enumerate(rows):
        sheet.paste(_cell(row, side), (k % columns * side, k // columns * side))
    out = io.BytesIO()
    sheet.quantize(_COLOURS, dither=Image.Dither.NONE).save(out, "PNG", optimize=True)
    return out.getvalue()


def _cell(row: LookRow, side: int) -> Image.Image:
    colour = _HELD if row.held else _WRITTEN if row.mended or row.flow is not None else _PLAIN
    cell = Image.new("RGB", (side, side), colour)
    inner = side - 2 * _EDGE_PX
    picture = _small(row.picture, inner)
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
