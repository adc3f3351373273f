"""Draw a dish insert at true size: as vectors (SVG), and in dots (PNG, PDF)."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from design.files import atomic_replacement, write_text
from registration.devices.camera_frame.insert import Insert

_LINE_MM: Final = 0.2
_TILES_MM: Final = 0.02
"""Cells are drawn wider by it, so that no hair of white shows between neighbours."""


def write_svg(path: Path, insert: Insert) -> None:
    """Write the insert as SVG, one unit a mm.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    wide, high = insert.plate_mm
    rows = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide:.4f}mm" height="{high:.4f}mm" '
        f'viewBox="0 0 {wide:.4f} {high:.4f}">',
        f'<rect width="{wide:.4f}" height="{high:.4f}" fill="#fff"/>',
        '<path fill="#000" d="',
        *(
            f"M{x + wide / 2:.4f} {high / 2 - y - h:.4f}h{w:.4f}v{h:.4f}h{-w:.4f}z"
            for x, y, w, h in _black(insert)
        ),
        '"/>',
        _hole_svg(insert),
        "</svg>",
    ]
    write_text(path, "\n".join(rows) + "\n")


def write_dots(path: Path, insert: Insert, dots_per_inch: int) -> None:
    """Write the insert as PNG or PDF (by the name's end), true size.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    image = Image.fromarray(drawn(insert, dots_per_inch / 25.4)).convert(
        "1", dither=Image.Dither.NONE
    )
    with atomic_replacement(path) as draft:
        if path.suffix.lower() == ".pdf":
            image.save(draft, "PDF", resolution=float(dots_per_inch))
        else:
            image.save(draft, "PNG", dpi=(dots_per_inch, dots_per_inch))


def drawn(insert: Insert, dots_per_mm: float) -> NDArray[np.uint8]:
    """Picture of the insert, (h, w), black 0 on white 255; its middle is the dish's."""
    wide, high = (round(side * dots_per_mm) for side in insert.plate_mm)
    image = Image.new("L", (wide, high), 255)
    pen = ImageDraw.Draw(image)
    hx, hy = insert.hole_mm[0] / 2 * dots_per_mm, insert.hole_mm[1] / 2 * dots_per_mm
    box = (wide / 2 - hx, high / 2 - hy, wide / 2 + hx, high / 2 + hy)
    line = max(1, round(_LINE_MM * dots_per_mm))
    (pen.ellipse if insert.shape == "round" else pen.rectangle)(box, outline=0, width=line)
    for x, y, w, h in _black(insert, 0.0):
        left, right = wide / 2 + x * dots_per_mm, wide / 2 + (x + w) * dots_per_mm
        top, bottom = high / 2 - (y + h) * dots_per_mm, high / 2 - y * dots_per_mm
        # A rectangle's last dot is drawn.
        pen.rectangle((round(left), round(top), round(right) - 1, round(bottom) - 1), fill=0)
    return np.asarray(image)


def _black(insert: Insert, wider: float = _TILES_MM) -> list[tuple[float, float, float, float]]:
    """Rectangles: left, bottom, width, height; mm."""
    side = insert.cell_mm
    cells = [
        (x - wider / 2, y - wider / 2, side + wider, side + wider)
        for x, y in insert.cells().tolist()
    ]
    return [*cells, *insert.bars()]


def _hole_svg(insert: Insert) -> str:
    wide, high = insert.plate_mm
    x, y = insert.hole_mm
    look = f'fill="none" stroke="#000" stroke-width="{_LINE_MM}"'
    if insert.shape == "round":
        return f'<circle cx="{wide / 2:.4f}" cy="{high / 2:.4f}" r="{x / 2:.4f}" {look}/>'
    return (
        f'<rect x="{(wide - x) / 2:.4f}" y="{(high - y) / 2:.4f}" width="{x:.4f}" '
        f'height="{y:.4f}" {look}/>'
    )
