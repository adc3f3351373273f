"""Test filaments of known width as G-code, for a plunger and for a valve."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from tests.printctl.checks.lumens.small_gcode import UL_PER_E

FEED_MM_S = 5.0


def plunger_gcode(passes: Sequence[tuple[ArrayLike, float]], decimals: int = 7) -> bytes:
    """Passes as (points (k, 3), diameter), lifted between; absolute E."""
    rows, pushed = ["M302 P1"], 0.0
    for points, diameter in passes:
        path = np.asarray(points, float)
        rows += ["G0 Z20 F600", f"G0 X{path[0, 0]:.5f} Y{path[0, 1]:.5f}"]
        rows += [f"G0 Z{path[0, 2]:.5f} F240", f"G1 F{60 * FEED_MM_S:g}"]
        for a, b in pairwise(path):
            pushed += float(np.linalg.norm(b - a)) * np.pi * diameter**2 / 4 / UL_PER_E
            rows.append(f"G1 X{b[0]:.5f} Y{b[1]:.5f} Z{b[2]:.5f} E{pushed:.{decimals}f}")
    return "\n".join([*rows, "G0 Z20 F600"]).encode() + b"\n"


def valve_gcode(
    passes: Sequence[tuple[ArrayLike, float]], opens: str, closes: str, waits: float
) -> bytes:
    """The same by a valve: passes as (points (k, 3), speed in mm/s), level."""
    rows = [closes]
    for points, speed in passes:
        path = np.asarray(points, float)
        rows += ["G0 Z20 F240", f"G0 X{path[0, 0]:.5f} Y{path[0, 1]:.5f} F2400"]
        rows += [f"G0 Z{path[0, 2]:.5f} F240", "M400", opens, f"G4 P{1e3 * waits:g}"]
        rows += [f"G1 X{b[0]:.5f} Y{b[1]:.5f} Z{b[2]:.5f} F{60 * speed:g}" for b in path[1:]]
        rows += ["M400", closes, f"G4 P{1e3 * waits:g}"]
    return "\n".join([*rows, "G0 Z20 F240"]).encode() + b"\n"
