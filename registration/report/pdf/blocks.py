"""Lay out blocks of the PDF: title, verdict box, grid of key figures, two columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from xml.sax.saxutils import escape

from reportlab.lib.colors import HexColor
from reportlab.platypus import Flowable, Spacer, TableStyle
from reportlab.platypus import Table as Grid

from registration.report.key_figures import KeyFigure
from registration.report.pdf.styles import (
    BAD,
    BULLET,
    GOOD,
    META,
    OUTCOME,
    OVERLINE,
    SMALL,
    TITLE,
    VALUE,
    WIDTH,
    rich,
    text,
)
from registration.report.svg import MUTED
from registration.report.wording import plain

_KEYS = 3
_GAP = 12.0
HALF = (WIDTH - _GAP) / 2
"""Width of one of a pair, points."""


def head(
    kind: str, title: str, meta: str, verdict: Mapping[str, Any], keys: Sequence[KeyFigure]
) -> list[Flowable]:
    """Name, verdict with its reasons, key figures."""
    made = [text(f"printctl · {kind}", OVERLINE), text(title, TITLE), text(meta, META)]
    return [*made, verdict_box(verdict), Spacer(0, 8), key_grid(keys), Spacer(0, 2)]


def outcome(verdict: Mapping[str, Any]) -> str:
    """The verdict in a word."""
    passed = verdict.get("passed")
    if not isinstance(passed, bool):
        return "No verdict"
    if passed:
        return "Pass"
    return (
        "Undecided: neither pass nor fail is proven" if verdict.get("undecided") is True else "Fail"
    )


def verdict_box(verdict: Mapping[str, Any]) -> Flowable:
    """The verdict and its reasons, with a bar of its colour beside them."""
    passed = verdict.get("passed")
    colour, sign = MUTED, ""
    if isinstance(passed, bool):
        colour, sign = (GOOD, "✓ ") if passed else (BAD, "✕ ")
    if verdict.get("undecided") is True:
        colour, sign = MUTED, "? "
    rows = [[text(sign + outcome(verdict), OUTCOME[colour])]]
    reasons = verdict.get("reasons")
    for reason in reasons if isinstance(reasons, list | tuple) else ():
        rows.append([text(plain(reason), BULLET, "•")])
    box = Grid(rows, [WIDTH], hAlign="LEFT")
    box.setStyle(
        TableStyle([
            ("LINEBEFORE", (0, 0), (0, -1), 3, HexColor(colour)),
            ("BACKGROUND", (0, 0), (-1, -1), HexColor("#f4f6f6")),
            ("LEFTPADDING", (0, 0), (-1, -1), 10),
            ("TOPPADDING", (0, 0), (-1, -1), 1),
            ("BOTTOMPADDING", (0, 0), (-1, -1), 1),
            ("TOPPADDING", (0, 0), (-1, 0), 6),
            ("BOTTOMPADDING", (0, 0), (-1, 0), 5),
            ("BOTTOMPADDING", (0, -1), (-1, -1), 7),
        ])
    )  # fmt: skip
    return box


def key_grid(keys: Sequence[KeyFigure]) -> Flowable:
    """Key figures, three in a row."""
    if not keys:
        return Spacer(0, 0)
    cells = [_key(figure) for figure in keys]
    cells += [[] for _ in range(-len(cells) % _KEYS)]
    rows = [cells[k : k + _KEYS] for k in range(0, len(cells), _KEYS)]
    table = Grid(rows, [WIDTH / _KEYS] * _KEYS, hAlign="LEFT")
    table.setStyle(_tight())
    return table


def _key(figure: KeyFigure) -> list[Flowable]:
    unit = f' <font size="8" color="{MUTED}">{escape(figure.unit)}</font>' if figure.unit else ""
    made = [text(figure.label, SMALL), rich(escape(figure.value) + unit, VALUE)]
    return [*made, text(figure.note, SMALL)] if figure.note else made


def pair(left: Sequence[Flowable], right: Sequence[Flowable]) -> Flowable:
    """Two columns side by side; what they hold is set for `HALF`."""
    table = Grid([[list(left), list(right)]], [HALF + _GAP, HALF], hAlign="LEFT")
    table.setStyle(_tight())
    return table


def _tight() -> TableStyle:
    return TableStyle([
        ("VALIGN", (0, 0), (-1, -1), "TOP"),
        ("LEFTPADDING", (0, 0), (-1, -1), 0),
        ("RIGHTPADDING", (0, 0), (-1, -1), 0),
        ("TOPPADDING", (0, 0), (-1, -1), 0),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 4),
    ])  # fmt: skip
