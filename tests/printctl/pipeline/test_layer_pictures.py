"""Layer pictures drawn from the G-code."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from lxml import etree

from firmware_profiles import Printer, load
from printctl.checks.gcode_view import Pushing
from printctl.pipeline.layer_pictures import layer_pictures
from tests.printctl.checks.lumens.small_gcode import BORE_MM, gcode

PUSHING = Pushing(load(Printer, "generic_marlin"), BORE_MM, "test", BORE_MM, "test")
ROWS = [np.array([[0.0, y], [10.0, y]]) for y in (0.0, 1.0, 2.0)]


def heights(svg: bytes) -> list[float]:
    """Heights of the filled outlines in the drawing, in its own unit."""
    found = []
    for path in etree.fromstring(svg).iter("{http://www.w3.org/2000/svg}path"):
        numbers = [
            float(v) for v in path.get("d", "").replace("z", "").split() if v[0] in "-.0123456789"
        ]
        if "L" in path.get("d", "") and len(numbers) > 40:
            found.append(max(numbers[1::2]) - min(numbers[1::2]))
    return found


def test_every_line_is_drawn_as_wide_as_its_own_ink(tmp_path: Path) -> None:
    """Two layers alike, but that the second has lines of half the width."""
    path = tmp_path / "part.gcode"
    sizes = []
    for width in (0.4, 0.2):
        path.write_bytes(gcode([ROWS] * 3, line_mm=width))
        svg = layer_pictures(path, PUSHING)["toolpath/Layer 2 of 3, tip at z = 0.12 mm"]
        sizes.append(float(np.median(heights(svg))))
    assert 1.8 < sizes[0] / sizes[1] < 2.3
