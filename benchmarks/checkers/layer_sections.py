"""Compare a layer's ink with the design's section: lumens left open, uncovered areas.

Shares no code with the product.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely

from benchmarks.checkers.read_gcode import Lines

LEAST_MM = 0.12
"""Narrower holes of a section aren't counted as holes."""
EVERY = 12


@dataclass(frozen=True)
class LayerSections:
    """Of every twelfth layer.

    Attributes
    ----------
    holes, closed : int
        Free places of the sections, within their bounds; those where less than 20 µm stays free.
    bare_percent : float, %
        Material that no line covers.
    """

    holes: int
    closed: int
    bare_percent: float


def compare_layers(lines: Lines, material: Callable[[float], shapely.Geometry]) -> LayerSections:
    """Hold lines against ``material`` (tip's height -> section at mid-layer, lines' frame)."""
    holes = closed = 0
    bare: list[float] = []
    for z in np.unique(np.round(lines.z, 4))[4:-4:EVERY]:
        section = material(float(z))
        here = np.abs(lines.z - z) < 1e-3
        ways = shapely.linestrings(np.stack([lines.start[here], lines.end[here]], axis=1))
        ink = shapely.union_all(shapely.buffer(ways, lines.width[here] / 2, quad_segs=8))
        for free in shapely.get_parts(shapely.difference(section.envelope, section)):
            if shapely.buffer(free, -LEAST_MM / 2).is_empty:
                continue
            holes += 1
            closed += shapely.buffer(shapely.difference(free, ink), -0.01).is_empty
        bare.append(shapely.difference(section, ink).area / section.area)
    return LayerSections(holes, closed, 100 * float(np.mean(bare)))
