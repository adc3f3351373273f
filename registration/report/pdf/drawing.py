"""Convert matplotlib's SVG figures to PDF drawings; embed PNG images."""

from __future__ import annotations

import base64
import io
import re
from typing import Any, Final

from lxml import etree  # type: ignore[import-untyped]
from reportlab.lib.colors import HexColor
from reportlab.lib.utils import ImageReader
from reportlab.pdfbase.pdfmetrics import stringWidth
from reportlab.platypus import Flowable, Image

from registration.report.errors import ReportError
from registration.report.pdf.paths import START, Style, matrices, numbers, styled, trace
from registration.report.pdf.styles import BOLD, CAPTION, FONT, MARGIN, PAGE, text, use_fonts

_SVG: Final = "{http://www.w3.org/2000/svg}"
_LINK: Final = "{http://www.w3.org/1999/xlink}href"
_JOINS: Final = {"miter": 0, "round": 1, "bevel": 2}
_CAPS: Final = {"butt": 0, "round": 1, "square": 2}
_SHARES: Final = {"start": 0.0, "middle": 0.5, "end": 1.0}
TALLEST: Final = PAGE[1] - 2 * MARGIN - 40.0
"""Of a drawing, points: a page with room for the caption."""
_PNG: Final = b"\x89PNG\r\n\x1a\n"


def figure(picture: bytes, caption: str, width: float) -> list[Flowable]:
    """A drawing with its caption, as wide as it likes to be and at most `width` points."""
    if picture.startswith(_PNG):
        across, up = ImageReader(io.BytesIO(picture)).getSize()
        factor = min(width / across, TALLEST / up)
        shown = Image(io.BytesIO(picture), factor * across, factor * up)
    else:
        shown = Drawing(picture, caption, width)
    shown.hAlign = "LEFT"
    return [shown, text(caption, CAPTION)]


class Drawing(Flowable):
    """An SVG as matplotlib writes it.

    Known are groups, paths, ``use``, text in one style, embedded PNG, rectangles as clips;
    the rest (filters, gradients, patterns) matplotlib doesn't write and is left out.

    Parameters
    ----------
    picture : bytes
    caption : str
        For the message when it can't be read.
    width : float, points
        At most.

    Raises
    ------
    ReportError
        When the bytes aren't an SVG with a ``viewBox``.
    """

    def __init__(self, picture: bytes, caption: str, width: float) -> None:
        super().__init__()
        use_fonts()
        parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True)
        try:
            self.root = etree.fromstring(picture, parser)
            _, _, across, up = numbers(self.root.get("viewBox", ""))
        except (etree.XMLSyntaxError, ValueError) as exc:
            raise ReportError(f"figure {caption!r} is neither PNG nor SVG ({exc})") from exc
        self.factor = min(1.0, width / across, TALLEST / up)
        self.up = up
        self.width, self.height = self.factor * across, self.factor * up
        self.known = {e.get("id"): e for e in self.root.iter() if e.get("id")}

    def draw(self) -> None:
        """Draw it; called by reportlab."""
        canvas = self.canv
        canvas.saveState()
        # An SVG counts y downwards.
        canvas.transform(self.factor, 0, 0, -self.factor, 0, self.height)
        for child in self.root:
            self._element(child, START)
        canvas.restoreState()

    def _element(self, element: Any, above: Style) -> None:
        tag = element.tag.removeprefix(_SVG) if isinstance(element.tag, str) else ""
        draw = {"g": self._group, "path": self._path, "use": self._use, "text": self._text,
                "image": self._image}.get(tag)  # fmt: skip
        if draw is None:
            return
        style = styled(element.attrib, above)
        self.canv.saveState()
        self._clip(element.get("clip-path"))
        for matrix in matrices(element.get("transform", "")):
            self.canv.transform(*matrix)
        draw(element, style)
        self.canv.restoreState()

    def _group(self, element: Any, style: Style) -> None:
        for child in element:
            self._element(child, style)

    def _use(self, element: Any, style: Style) -> None:
        self.canv.translate(float(element.get("x", 0)), float(element.get("y", 0)))
        target = self.known.get(element.get(_LINK, "").removeprefix("#"))
        if target is not None:
            self._path(target, styled(target.attrib, style))

    def _path(self, element: Any, style: Style) -> None:
        fill, stroke = style["fill"] != "none", style["stroke"] != "none"
        outline = element.get("d", "")
        if not outline or not (fill or stroke):
            return
        self._paint(style)
        path = self.canv.beginPath()
        trace(path, outline)
        self.canv.drawPath(path, stroke=int(stroke), fill=int(fill))

    def _paint(self, style: Style) -> None:
        canvas, opacity = self.canv, float(style["opacity"])
        if style["fill"] != "none":
            canvas.setFillColor(HexColor(style["fill"]))
            canvas.setFillAlpha(opacity * float(style.get("fill-opacity", 1)))
        if style["stroke"] == "none":
            return
        canvas.setStrokeColor(HexColor(style["stroke"]))
        canvas.setStrokeAlpha(opacity * float(style.get("stroke-opacity", 1)))
        canvas.setLineWidth(numbers(style["stroke-width"])[0])
        canvas.setLineJoin(_JOINS.get(style["stroke-linejoin"], 1))
        canvas.setLineCap(_CAPS.get(style["stroke-linecap"], 0))
        dashes = numbers(style["stroke-dasharray"])
        if dashes:
            canvas.setDash(dashes, numbers(style.get("stroke-dashoffset", "0"))[0])

    def _text(self, element: Any, style: Style) -> None:
        words = "".join(element.itertext()).strip()
        size = numbers(style.get("font-size") or re.sub(r"^\D*\d+ ", "", style.get("font", "10")))
        bold = "bold" in style.get("font-weight", "") or "bold" in style.get("font", "")
        font = BOLD if bold else FONT
        canvas = self.canv
        self._paint(style)
        canvas.translate(float(element.get("x", 0)), float(element.get("y", 0)))
        canvas.scale(1, -1)
        canvas.setFont(font, size[0])
        canvas.drawString(
            -_SHARES.get(style["text-anchor"], 0.0) * stringWidth(words, font, size[0]), 0, words
        )

    def _image(self, element: Any, style: Style) -> None:
        source = element.get(_LINK, "")
        if not source.startswith("data:image/png;base64,"):
            return
        x, y, across, up = (float(element.get(k, 0)) for k in ("x", "y", "width", "height"))
        data = base64.b64decode(source.partition(",")[2])
        self.canv.translate(x, y + up)
        self.canv.scale(1, -1)
        self.canv.drawImage(ImageReader(io.BytesIO(data)), 0, 0, across, up, mask="auto")

    def _clip(self, name: str | None) -> None:
        area = self.known.get((name or "").removeprefix("url(#").removesuffix(")"))
        if area is None:
            return
        path = self.canv.beginPath()
        for shape in area:
            if shape.tag == f"{_SVG}rect":
                path.rect(*(float(shape.get(k, 0)) for k in ("x", "y", "width", "height")))
            elif shape.tag == f"{_SVG}path":
                trace(path, shape.get("d", ""))
        self.canv.clipPath(path, stroke=0, fill=0)
