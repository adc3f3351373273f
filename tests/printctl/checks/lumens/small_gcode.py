"""Handwritten small prints as G-code, of known geometry."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from kernels.arrays import FloatArray

Strokes = list[FloatArray]

LAYER_MM, LINE_MM = 0.06, 0.15
BORE_MM = 2.0
UL_PER_E = float(np.pi / 4 * BORE_MM**2)
SIDES = 96


def gcode(
    layers: Sequence[Strokes], *, decimals: int = 9, head: str = "", line_mm: float = LINE_MM
) -> bytes:
    """Strokes (k, 2) by layer, as absolute E; the tip stands at each layer's top."""
    rows = [head] if head else []
    pushed = 0.0
    for k, strokes in enumerate(layers):
        rows.append(f"G0 Z{(k + 1) * LAYER_MM:.4f} F300")
        for stroke in strokes:
            rows.append(f"G0 X{stroke[0, 0]:.6f} Y{stroke[0, 1]:.6f}")
            for a, b in pairwise(stroke):
                pushed += float(np.linalg.norm(b - a)) * section(line_mm) / UL_PER_E
                rows.append(f"G1 X{b[0]:.6f} Y{b[1]:.6f} E{pushed:.{decimals}f}")
    return "\n".join(rows).encode() + b"\n"


def section(width_mm: float) -> float:
    """Cross-section of a line with round sides, mm²: a band between two half circles."""
    return (width_mm - LAYER_MM) * LAYER_MM + np.pi / 4 * LAYER_MM**2


def ring(
    centre: tuple[float, float], radius: float, gap: tuple[float, float] | None = None
) -> FloatArray:
    """A polygon about a circle; ``gap`` leaves out angles between two values, rad."""
    first, last = (0.0, 2 * np.pi) if gap is None else (gap[1], gap[0] + 2 * np.pi)
    angle = np.linspace(first, last, SIDES + 1)
    out = radius if gap is not None else radius / np.cos(np.pi / SIDES)
    return np.array(centre) + out * np.column_stack([np.cos(angle), np.sin(angle)])


def tube(
    radius: float,
    walls: int = 4,
    centre: tuple[float, float] = (0.0, 0.0),
    gap: tuple[float, float] | None = None,
) -> Strokes:
    """Rings that leave a round lumen open."""
    return [ring(centre, radius + (k + 0.5) * LINE_MM, gap) for k in range(walls)]


# --- filaments of known width, for a plunger and for a valve
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
