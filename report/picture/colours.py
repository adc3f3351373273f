"""Colour constants and scales shared by the 3D views, the pictures and the drawings.

The diverging scale runs from blue over light grey to orange-brown, with equal lightness at equal
distance from zero. Blue against orange stays apart in every common form of colour blindness, and
lightness alone shows how far a value is from zero. Kinds and trees take colours of Okabe & Ito's
set (2008, "Color Universal Design").
"""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import LinearSegmentedColormap, to_hex

DIVERGING_ANCHORS: Final = (
    "#0a3161", "#1f64a5", "#5fa2d3", "#b3d3e8", "#eeeeec",
    "#f3c9a0", "#e0914c", "#b85a14", "#6e2f06",
)  # fmt: skip
NO_DATA: Final = "#9aa1a8"
KIND_COLOURS: Final = {
    "artery": "#d55e00",
    "vein": "#0072b2",
    "lymph": "#009e73",
    "connection": "#cc79a7",
    "channel": "#56b4e9",
}
TREE_COLOURS: Final = (
    "#d55e00", "#0072b2", "#009e73", "#e69f00", "#cc79a7", "#56b4e9", "#8c6d31", "#5b5ea6",
)  # fmt: skip

DIVERGING: Final = LinearSegmentedColormap.from_list("deviation", DIVERGING_ANCHORS)
# Viridis without its darkest and brightest ends, which sink into a dark or a light page.
SEQUENTIAL: Final = LinearSegmentedColormap.from_list(
    "magnitude", colormaps["viridis"](np.linspace(0.16, 0.95, 33))
)


def samples(diverging: bool, count: int = 33) -> list[str]:
    """Colours at ``count`` equal steps along a scale, as ``#rrggbb``."""
    scale = DIVERGING if diverging else SEQUENTIAL
    return [to_hex(scale(x)) for x in np.linspace(0.0, 1.0, count)]
