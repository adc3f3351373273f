"""Write the HTML page of a well plate job, with the plate's picture."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from string import ascii_uppercase
from typing import Any, Final
from xml.sax.saxutils import escape

from design.files import write_text
from firmware_profiles import Plate
from report.page_frame import render
from report.sections.facts import check_table, mapping, records, timing_rows
from report.sections.tables import Column, Table, make_table
from report.svg import ACCENT, INK, MUTED, RULE, inline_figure

GOOD: Final = "#17714a"
BAD: Final = "#ad3517"
_SCALE: Final = 6.0
"""Pixels for a millimetre."""
_EDGE_MM: Final = 5.0
_PALEST, _DARKEST = 0.08, 0.5
_FONT: Final = "Inter, Helvetica Neue, Segoe UI, Arial, Liberation Sans, sans-serif"


def plate_figure(plate: Plate, wells: Sequence[Mapping[str, Any]]) -> bytes:
    """Draw the plate as SVG, A1 behind on the left, however it stands on the printer.

    Parameters
    ----------
    plate : Plate
    wells : sequence of dict
        Those that are printed in, in their order: ``well``, ``label``, ``variant`` (from 1), and
        ``passed`` where a scan was judged.
    """
    width, height = plate.length_mm + 2 * _EDGE_MM, plate.width_mm + 2 * _EDGE_MM
    filled = {str(row["well"]): row for row in wells}
    count = max((int(row["variant"]) for row in wells), default=1)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width * _SCALE:g} '
        f'{height * _SCALE:g}" width="{width * _SCALE:g}" height="{height * _SCALE:g}" '
        f'font-family="{_FONT}">',
        f"<title>{escape(plate.name)}</title>",
        _outline(plate),
        *_headings(plate),
        *(_well(plate, name, filled.get(name), count) for name in plate.wells),
        _way(plate, [str(row["well"]) for row in wells]),
        *(_names(plate, row) for row in wells),
        "</svg>\n",
    ]
    return "\n".join(part for part in parts if part).encode()


def _at(plate: Plate, well: str) -> tuple[float, float]:
    """Middle of a well, pixels."""
    right, behind = plate.offset_mm(well)
    x = _EDGE_MM + plate.length_mm / 2 + right
    y = _EDGE_MM + plate.width_mm / 2 - behind
    return x * _SCALE, y * _SCALE


def _outline(plate: Plate) -> str:
    return (
        f'<rect x="{_EDGE_MM * _SCALE:g}" y="{_EDGE_MM * _SCALE:g}" '
        f'width="{plate.length_mm * _SCALE:g}" height="{plate.width_mm * _SCALE:g}" '
        f'rx="{3 * _SCALE:g}" fill="none" stroke="{RULE}" stroke-width="2"/>'
    )


def _headings(plate: Plate) -> list[str]:
    size = _SCALE * min(3.4, plate.pitch_x_mm / 3)
    columns = [(f"A{k + 1}", str(k + 1)) for k in range(plate.columns)]
    rows = [(f"{ascii_uppercase[k]}1", ascii_uppercase[k]) for k in range(plate.rows)]
    low = (_EDGE_MM + 1) * _SCALE
    headings = [_text(_at(plate, well)[0], low + size, size, MUTED, text) for well, text in columns]
    return headings + [
        _text(low + size / 2, _at(plate, well)[1] + size / 3, size, MUTED, text)
        for well, text in rows
    ]


def _well(plate: Plate, name: str, row: Mapping[str, Any] | None, count: int) -> str:
    x, y = _at(plate, name)
    fill, opacity, line, width = "none", 1.0, RULE, 1.5
    if row is not None:
        share = (int(row["variant"]) - 1) / max(count - 1, 1)
        fill, opacity, line = ACCENT, _PALEST + share * (_DARKEST - _PALEST), ACCENT
        if row.get("passed") is not None:
            line, width = (GOOD if row["passed"] else BAD), 5.0
    style = f'fill="{fill}" fill-opacity="{opacity:.3f}" stroke="{line}" stroke-width="{width:g}"'
    w, h = plate.well_x_mm * _SCALE, plate.well_y_mm * _SCALE
    if plate.shape == "round":
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{w / 2:.1f}" {style}/>'
    return (
        f'<rect x="{x - w / 2:.1f}" y="{y - h / 2:.1f}" width="{w:.1f}" height="{h:.1f}" {style}/>'
    )


def _way(plate: Plate, wells: Sequence[str]) -> str:
    """The order, as lines from rim to rim with a dot where the first begins."""
    reach = 0.55 * min(plate.well_x_mm, plate.well_y_mm) * _SCALE
    ways: list[str] = []
    for one, other in pairwise(wells):
        (x0, y0), (x1, y1) = _at(plate, one), _at(plate, other)
        share = reach / math.hypot(x1 - x0, y1 - y0)
        if not ways:
            dot = f'cx="{x0 + share * (x1 - x0):.1f}" cy="{y0 + share * (y1 - y0):.1f}" r="4.5"'
            ways.append(f'<circle {dot} fill="{MUTED}"/>')
        ways.append(
            f'<line x1="{x0 + share * (x1 - x0):.1f}" y1="{y0 + share * (y1 - y0):.1f}" '
            f'x2="{x1 - share * (x1 - x0):.1f}" y2="{y1 - share * (y1 - y0):.1f}" '
            f'stroke="{MUTED}" stroke-width="2"/>'
        )
    return "".join(ways)


def _names(plate: Plate, row: Mapping[str, Any]) -> str:
    """Number of the variant in the well, and its label where there is room."""
    x, y = _at(plate, str(row["well"]))
    room = plate.well_x_mm * _SCALE
    size = min(30.0, 0.4 * room)
    words = str(row["label"]).split(", ")
    small = min(15.0, 1.6 * room / max(len(word) for word in words))
    if small < 7.0 or len(words) * small > 0.4 * room:
        return _text(x, y + 0.35 * size, size, INK, str(row["variant"]))
    lines = [
        _text(x, y + 0.02 * room + (k + 0.9) * small * 1.15, small, INK, word)
        for k, word in enumerate(words)
    ]
    return _text(x, y - 0.12 * room, size, INK, str(row["variant"])) + "".join(lines)


def _text(x: float, y: float, size: float, colour: str, text: str) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size:.1f}" text-anchor="middle" '
        f'fill="{colour}">{escape(text)}</text>'
    )


_WELL: Final = (
    Column("well", "Well", kind="text"),
    Column("variant", "Variant"),
)
_DONE: Final = (
    Column("ink_ul", "Ink", "µL"),
    Column("begins_s", "Begins", "s"),
    Column("lasts_s", "Lasts", "s"),
    Column("x_mm", "x", "mm"),
    Column("y_mm", "y", "mm"),
    Column("first_line", "From line"),
    Column("last_line", "To line"),
)
_SCANNED: Final = (
    Column("outcome", "Scan", kind="text"),
    Column("rms_um", "RMS, scaled", "µm"),
    Column("mean_error_percent", "Diameters, mean error", "%", kind="signed"),
    Column("worst_error_percent", "worst", "%", kind="signed"),
)


def write_plate_html(path: Path, data: Mapping[str, Any], plate: Plate) -> None:
    """Write the page as one HTML file that opens offline.

    Parameters
    ----------
    path : Path
        The file; an old one is replaced only by a whole new one.
    data : dict
        What the plate's report.json holds.
    plate : Plate

    Raises
    ------
    OSError
        When the file can't be written.
    """
    wells = records(data, "wells")
    context = {
        "data": data,
        "picture": inline_figure(plate_figure(plate, wells), f"{plate.name}, from above", "p-"),
        "well_table": well_table(wells),
        "check_table": check_table(mapping(data, "dry_run")),
        "timing_rows": timing_rows(mapping(data, "timings")),
        "variants": _variants(wells),
    }
    write_text(path, render("plate.html", context))


def well_table(wells: Sequence[Mapping[str, Any]]) -> Table:
    """A row for each well in the printing order, swept keys as columns of their own."""
    keys = list(dict.fromkeys(key for row in wells for key in row["values"]))
    swept = tuple(
        Column(f"v{k}", key, kind=_kind([row["values"].get(key) for row in wells]))
        for k, key in enumerate(keys)
    )
    rows = [
        {**row, **{f"v{k}": row["values"].get(key) for k, key in enumerate(keys)}} for row in wells
    ]
    columns = (*_WELL, *swept, Column("copy", "Copy"), *_SCANNED, *_DONE)
    return make_table("wells", rows, columns, order="as printed")


def _kind(values: Sequence[Any]) -> Any:
    numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    return "number" if numbers else "text"


@dataclass(frozen=True)
class _Variant:
    """Of a plate's wells, as the page's template shows it."""

    number: int
    label: str
    wells: list[str]


def _variants(wells: Sequence[Mapping[str, Any]]) -> list[_Variant]:
    """Number, label and wells of each variant."""
    variants: dict[int, _Variant] = {}
    for row in sorted(wells, key=lambda row: (row["variant"], row["copy"])):
        text = row["label"] if row["values"] else "as the recipe says"
        one = variants.setdefault(row["variant"], _Variant(row["variant"], text, []))
        one.wells.append(row["well"])
    return list(variants.values())
