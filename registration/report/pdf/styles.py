"""Fonts, colours and paragraph styles of the PDF."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Final
from xml.sax.saxutils import escape

import matplotlib
from reportlab.lib.pagesizes import A4
from reportlab.lib.styles import ParagraphStyle
from reportlab.lib.units import mm
from reportlab.pdfbase import pdfmetrics
from reportlab.pdfbase.ttfonts import TTFont
from reportlab.platypus import Paragraph

from registration.report.svg import INK, MUTED

FONT: Final = "DejaVuSans"
BOLD: Final = "DejaVuSans-Bold"
GOOD: Final = "#17714a"
BAD: Final = "#ad3517"
PAGE: Final = A4
MARGIN: Final = 16 * mm
WIDTH: Final = PAGE[0] - 2 * MARGIN
"""Of what is set, points."""


@cache
def use_fonts() -> None:
    """Make matplotlib's own DejaVu known; it has every sign that the report uses."""
    folder = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    for name in (FONT, BOLD):
        pdfmetrics.registerFont(TTFont(name, str(folder / f"{name}.ttf")))
    pdfmetrics.registerFontFamily(FONT, normal=FONT, bold=BOLD, italic=FONT, boldItalic=BOLD)


def _style(name: str, size: float, **more: object) -> ParagraphStyle:
    given = {"fontName": FONT, "textColor": INK, "leading": 1.38 * size, **more}
    return ParagraphStyle(name, fontSize=size, **given)


TITLE: Final = _style("title", 17, fontName=BOLD, leading=21, spaceAfter=2)
OVERLINE: Final = _style("overline", 7.5, textColor=MUTED, spaceAfter=3)
META: Final = _style("meta", 7.5, textColor=MUTED, spaceAfter=8)
HEADING: Final = _style("heading", 12, fontName=BOLD, spaceBefore=14, spaceAfter=5, keepWithNext=1)
MINOR: Final = _style("minor", 9, fontName=BOLD, spaceBefore=9, spaceAfter=4, keepWithNext=1)
BODY: Final = _style("body", 8.2)
SMALL: Final = _style("small", 6.8, textColor=MUTED, spaceBefore=2)
CAPTION: Final = _style("caption", 7, textColor=MUTED, spaceBefore=1, spaceAfter=4)
OUTCOME: Final = {
    colour: _style("outcome", 14, fontName=BOLD, textColor=colour) for colour in (GOOD, BAD, MUTED)
}
BULLET: Final = _style("bullet", 8.2, leftIndent=9, bulletIndent=0, spaceBefore=1.5)
VALUE: Final = _style("value", 14, leading=17)


def text(words: str, style: ParagraphStyle = BODY, bullet: str | None = None) -> Paragraph:
    """A paragraph of plain text: nothing in it is taken for markup."""
    use_fonts()
    return Paragraph(escape(words), style, bulletText=bullet)


def rich(markup: str, style: ParagraphStyle = BODY) -> Paragraph:
    """A paragraph of reportlab's markup; whoever calls has escaped what came from outside."""
    use_fonts()
    return Paragraph(markup, style)
