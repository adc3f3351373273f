"""Handwritten small prints as G-code, of known geometry."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

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
