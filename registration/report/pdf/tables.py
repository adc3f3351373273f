"""Lay out report tables for the PDF: column widths, wide tables split, headings on each page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from reportlab.lib.colors import HexColor
from reportlab.pdfbase.pdfmetrics import stringWidth
from reportlab.platypus import Flowable, LongTable, Spacer, TableStyle
from reportlab.platypus import Table as Grid

from registration.report.pdf.styles import BAD, FONT, SMALL, WIDTH, text, use_fonts
from registration.report.sections import Fact
from registration.report.svg import INK, MUTED, RULE
from registration.report.tables import Column, Table
from registration.report.wording import number

_PAD: Final = 3.0
_SIZES: Final = (7.2, 6.8, 6.4, 6.0, 5.8)
"""Of the letters, points: the first with which all columns fit."""
_WIDEST: Final = 34
"""Letters a text may have on a line."""
_WIDEST_HEAD: Final = 11


def data_table(table: Table, width: float = WIDTH) -> list[Flowable]:
    """A table of the report; a line below it says what isn't shown.

    Columns that don't fit beside the others follow in a table of their own, which begins with
    the first column again.
    """
    use_fonts()
    columns = [
        (_broken_head(column), *(_broken(row.cells[c].text) for row in table.rows))
        for c, column in enumerate(table.columns)
    ]
    made: list[Flowable] = []
    for part in _parts([_needed(column, _SIZES[-1]) for column in columns], width):
        heads, *rows = zip(*(columns[c] for c in part), strict=True)
        numeric = [table.columns[c].numeric for c in part]
        made += [grid(heads, rows, numeric, width, _bad(table, part)), Spacer(0, 5)]
    if table.total > len(table.rows):
        said = f"{number(len(table.rows))} of {number(table.total)} rows shown ({table.order})"
        made.append(text(said, SMALL))
    return made


def _parts(widths: Sequence[float], room: float) -> list[list[int]]:
    """Columns of as few tables as fit into `room`, the first in each, evenly filled."""
    rest = room - widths[0]
    for count in range(1, len(widths)):
        limit = sum(widths[1:]) / count
        while limit <= rest:
            parts = _filled(widths, limit)
            if len(parts) <= count:
                return parts
            limit += 2.0
    return _filled(widths, rest)


def _filled(widths: Sequence[float], limit: float) -> list[list[int]]:
    """Columns in their order, as many in each part as `limit` takes beside the first."""
    parts, used = [[0]], 0.0
    for c in range(1, len(widths)):
        if len(parts[-1]) > 1 and used + widths[c] > limit + 1e-6:
            parts, used = [*parts, [0]], 0.0
        parts[-1].append(c)
        used += widths[c]
    return parts


def _bad(table: Table, part: Sequence[int]) -> list[Any]:
    """Style of the cells that are marked as bad."""
    return [
        ("TEXTCOLOR", (at, r + 1), (at, r + 1), HexColor(BAD))
        for r, row in enumerate(table.rows)
        for at, c in enumerate(part)
        if row.cells[c].mark == "bad"
    ]


def grid(
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    numeric: Sequence[bool],
    width: float = WIDTH,
    more: Sequence[Any] = (),
) -> Flowable:
    """A table of plain text whose head is repeated on every page.

    Parameters
    ----------
    heads, rows : text
    numeric : sequence of bool
        Columns that are set flush right.
    width : float, points
        It takes no more; letters shrink before that.
    more : sequence
        Further style commands of reportlab.
    """
    use_fonts()
    columns = list(zip(heads, *rows, strict=True))
    for size in _SIZES:
        widths = [_needed(column, size) for column in columns]
        if sum(widths) <= width:
            break
    spare = (width - sum(widths)) / len(widths)
    # Not spread thin: a gap wider than this loses the line.
    widths = [w + min(spare, 22.0) for w in widths]
    table = LongTable([list(heads), *map(list, rows)], widths, repeatRows=1, hAlign="LEFT")
    table.setStyle(TableStyle([*_look(size), *_right(numeric), *more]))
    return table


def fact_lines(facts: Sequence[Fact], width: float = WIDTH) -> Flowable:
    """Labels and values, a line each; long values are broken."""
    use_fonts()
    rows = [[text(f.label, SMALL), text(f"{f.value} {f.unit}".strip(), _FACT)] for f in facts]
    table = Grid(rows, [0.42 * width, 0.58 * width], hAlign="LEFT")
    table.setStyle(
        TableStyle([
            ("LINEBELOW", (0, 0), (-1, -1), 0.4, HexColor(RULE)),
            ("VALIGN", (0, 0), (-1, -1), "TOP"),
            ("TOPPADDING", (0, 0), (-1, -1), 0.5),
            ("BOTTOMPADDING", (0, 0), (-1, -1), 2.5),
            ("LEFTPADDING", (0, 0), (-1, -1), 0),
            ("RIGHTPADDING", (0, 0), (-1, -1), 4),
        ])
    )  # fmt: skip
    return table


_FACT: Final = SMALL.clone("fact", textColor=INK)


def _look(size: float) -> list[Any]:
    return [
        ("FONT", (0, 0), (-1, -1), FONT, size, 1.22 * size),
        ("TEXTCOLOR", (0, 0), (-1, -1), HexColor(INK)),
        ("TEXTCOLOR", (0, 0), (-1, 0), HexColor(MUTED)),
        ("VALIGN", (0, 0), (-1, 0), "BOTTOM"),
        ("VALIGN", (0, 1), (-1, -1), "TOP"),
        ("LINEBELOW", (0, 0), (-1, 0), 0.7, HexColor(MUTED)),
        ("LINEBELOW", (0, 1), (-1, -1), 0.3, HexColor(RULE)),
        ("LEFTPADDING", (0, 0), (-1, -1), _PAD),
        ("RIGHTPADDING", (0, 0), (-1, -1), _PAD),
        ("LEFTPADDING", (0, 0), (0, -1), 0),
        ("TOPPADDING", (0, 0), (-1, -1), 1.6),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 2.2),
    ]


def _right(numeric: Sequence[bool]) -> list[Any]:
    return [("ALIGN", (c, 0), (c, -1), "RIGHT") for c, is_number in enumerate(numeric) if is_number]


def _needed(cells: Sequence[str], size: float) -> float:
    lines = {line for cell in cells for line in cell.split("\n")}
    return 2 * _PAD + max((stringWidth(line, FONT, size) for line in lines), default=0.0)


def _broken_head(column: Column) -> str:
    """A heading of short lines, its unit on the last."""
    label = _broken(column.label, _WIDEST_HEAD)
    return f"{label}\n{column.unit}" if column.unit else label


def _broken(cell: str, letters: int = _WIDEST) -> str:
    """Text broken between words where a line would be too long, and in a word that is."""
    words = [
        word[k : k + _WIDEST] for word in cell.split(" ") for k in range(0, len(word), _WIDEST)
    ]
    lines = [""]
    for word in words:
        if lines[-1] and len(lines[-1]) + len(word) >= letters:
            lines.append(word)
        else:
            lines[-1] = f"{lines[-1]} {word}" if lines[-1] else word
    return "\n".join(lines)
