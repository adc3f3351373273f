"""Lay out PDF content on pages with a footer; return the file's bytes."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from reportlab.lib.colors import HexColor
from reportlab.pdfbase.pdfmetrics import stringWidth
from reportlab.pdfgen.canvas import Canvas
from reportlab.platypus import BaseDocTemplate, Flowable, Frame, PageTemplate

from registration.report.pdf.styles import FONT, MARGIN, PAGE, use_fonts
from registration.report.svg import MUTED, RULE

_TOTAL: Final = "total"
_SIZE: Final = 7.0
_FOOT: Final = 0.62 * MARGIN
_LETTERS: Final = 100
"""That a footer may have beside the page's number."""


@dataclass(frozen=True)
class Facts:
    """What the file says of itself.

    Attributes
    ----------
    title, subject : str
        Shown by a viewer beside the file's name; the subject holds the verdict.
    footer : str
        Left at the foot of every page.
    """

    title: str
    subject: str
    footer: str


def build_pdf(story: Sequence[Flowable], facts: Facts) -> bytes:
    """Lay a story out on A4; same story, same bytes."""
    use_fonts()
    stream = io.BytesIO()
    document = BaseDocTemplate(
        stream,
        pagesize=PAGE,
        title=facts.title,
        subject=facts.subject,
        author="printctl",
        creator="printctl",
        lang="en",
        # No time of writing, and an identity that follows from the content.
        invariant=1,
    )

    def foot(canvas: Any, _: Any) -> None:
        _footer(canvas, facts.footer)

    document.addPageTemplates(PageTemplate("page", [_frame()], onPage=foot))
    document.build(list(story), canvasmaker=_CountedCanvas)
    return stream.getvalue()


def _frame() -> Frame:
    across, up = PAGE
    return Frame(
        MARGIN, MARGIN + 4, across - 2 * MARGIN, up - 2 * MARGIN - 4,
        leftPadding=0, rightPadding=0, topPadding=0, bottomPadding=0,
    )  # fmt: skip


class _CountedCanvas(Canvas):
    """A canvas that writes the number of pages, known at the end, wherever it is asked for."""

    def save(self) -> None:
        """Define what every footer refers to, then save."""
        pages = self.getPageNumber() - 1
        self.beginForm(_TOTAL, 0, 0, 40, 2 * _SIZE)
        self.setFont(FONT, _SIZE)
        self.setFillColor(HexColor(MUTED))
        self.drawString(0, _SIZE / 2, str(pages))
        self.endForm()
        super().save()


def _footer(canvas: Any, words: str) -> None:
    left, right = MARGIN, PAGE[0] - MARGIN
    canvas.saveState()
    canvas.setStrokeColor(HexColor(RULE))
    canvas.setLineWidth(0.4)
    canvas.line(left, _FOOT + 1.6 * _SIZE, right, _FOOT + 1.6 * _SIZE)
    canvas.setFont(FONT, _SIZE)
    canvas.setFillColor(HexColor(MUTED))
    canvas.drawString(left, _FOOT, words if len(words) <= _LETTERS else f"{words[:_LETTERS]}…")
    room = stringWidth("00", FONT, _SIZE)
    canvas.drawRightString(right - room, _FOOT, f"page {canvas.getPageNumber()} of ")
    canvas.translate(right - room, _FOOT - _SIZE / 2)
    canvas.doForm(_TOTAL)
    canvas.restoreState()
