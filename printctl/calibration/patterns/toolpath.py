"""Convert a calibration pattern to a toolpath: prime, write, relieve and lift for each stroke."""

from __future__ import annotations

from typing import Final

import numpy as np

from design.toolpath import MoveBuilder, Toolpath
from firmware_profiles import Ink
from printctl.calibration.patterns.plan import Pattern

LIFT_MM: Final = 2.0
"""Above what is written, between two strokes."""
_TRAVEL_MM_S: Final = 10.0


def pattern_path(pattern: Pattern, ink: Ink) -> Toolpath:
    """Write each stroke: prime, wait as the ink asks, write, relieve, lift, go to the next.

    A bridge's sources are its layers, of others the strokes in their order: a print may be held
    between two of them.
    """
    layered = pattern.name == "bridge"
    height = pattern.bead.layer_mm if layered or not pattern.bead.round_bead else 0.0
    builder = MoveBuilder(pattern.strokes[0].points[0], "layer", height)
    for order, stroke in enumerate(pattern.strokes):
        z = stroke.points[0, 2]
        source = round(z / pattern.bead.layer_mm) if layered else order
        if order:
            up = max(builder.tip[2], z) + LIFT_MM
            over = np.array([[*builder.tip[:2], up], [*stroke.points[0, :2], up], stroke.points[0]])
            builder.travel(over, _TRAVEL_MM_S, source)
        builder.plunge(ink.retract_ul, ink.plunger_ul_s, source)
        builder.dwell(ink.dwell_s, source)
        way = np.linalg.norm(np.diff(stroke.points, axis=0), axis=1)
        volume = way * pattern.bead.area_mm2 * stroke.flow
        builder.write(stroke.points[1:], volume, stroke.speed_mm_s, source)
        builder.plunge(-ink.retract_ul, ink.plunger_ul_s, source)
    return builder.build()
