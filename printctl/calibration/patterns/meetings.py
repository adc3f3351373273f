"""Calibration patterns of lines that touch or nearly do: comb of gaps, branch joints, bridges."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from printctl.calibration.patterns.plan import (
    MARGIN_MM,
    Bead,
    Pattern,
    Question,
    Stroke,
    frame,
    straight,
)
from printctl.errors import UsageError

MOST: Final = 24
_ACROSS: Final = 9
"""Ways across each gap."""
_TOOTH_MM: Final = 14.0
"""Long enough for a lag to be over in its middle."""
_BRANCH_MM: Final = 6.0
_PILLAR_MM: Final = 2.0


def comb_pattern(bead: Bead, gaps_mm: Sequence[float], speed_mm_s: float) -> Pattern:
    """Parallel teeth whose gaps, edge to edge as commanded, widen from the first to the last."""
    gaps = _ordered(gaps_mm, "--gaps")
    _above(gaps, 0, "--gaps", "mm between edges")
    size = (
        _TOOTH_MM + 2 * MARGIN_MM,
        2 * MARGIN_MM + sum(gaps) + len(gaps) * bead.width_mm,
    )
    y = MARGIN_MM + np.concatenate([[0.0], np.cumsum(np.array(gaps) + bead.width_mm)])
    strokes = frame(size, speed_mm_s)
    for place, at in enumerate(y.tolist()):
        ends = (MARGIN_MM, MARGIN_MM + _TOOTH_MM)[:: -1 if place % 2 else 1]
        strokes.append(straight(place + 1, "tooth", [(x, at) for x in ends], speed_mm_s))
    x = MARGIN_MM + np.linspace(0.35, 0.65, _ACROSS) * _TOOTH_MM
    asked = [
        Question(
            k + 1, gap, np.stack([np.column_stack([x, 0 * x + y[k + end]]) for end in (0, 1)], 1)
        )
        for k, gap in enumerate(gaps)
    ]
    return Pattern("comb", bead, size, tuple(strokes), tuple(asked))


def joint_pattern(bead: Bead, overlaps: Sequence[float], speed_mm_s: float) -> Pattern:
    """Branches that end at a trunk, each so many radii beyond the trunk's surface."""
    ordered = _ordered(overlaps, "--overlaps")
    if min(ordered) < -4 or max(ordered) > 2:
        raise UsageError(
            f"--overlaps {ordered} aren't within -4 to 2 radii beyond the trunk's surface (2 is "
            "its other side)"
        )
    radius, spacing = bead.width_mm / 2, max(10 * bead.width_mm, 3.0)
    size = (
        2 * MARGIN_MM + (len(ordered) + 1) * spacing,
        2 * MARGIN_MM + _BRANCH_MM,
    )
    across = [(MARGIN_MM, MARGIN_MM), (size[0] - MARGIN_MM, MARGIN_MM)]
    strokes = [*frame(size, speed_mm_s), straight(0, "trunk", across, speed_mm_s)]
    asked = []
    for k, overlap in enumerate(ordered):
        x, top = MARGIN_MM + (k + 1) * spacing, MARGIN_MM + _BRANCH_MM
        end = MARGIN_MM + radius - overlap * radius
        strokes.append(straight(k + 1, "branch", [(x, top), (x, end)], speed_mm_s))
        shift = np.linspace(-0.15, 0.15, _ACROSS) * bead.width_mm
        # From the branch's body, clear of its end, to the trunk's middle.
        body = max(end, MARGIN_MM) + 4 * bead.width_mm
        ways = [[(x + s, min(body, top)), (x + s, MARGIN_MM)] for s in shift.tolist()]
        asked.append(Question(k + 1, overlap, np.array(ways)))
    return Pattern("joint", bead, size, tuple(strokes), tuple(asked))


def bridge_pattern(
    bead: Bead, spans_mm: Sequence[float], height_mm: float, speed_mm_s: float
) -> Pattern:
    """Pairs of pillars, layer by layer, and a line over each gap between them."""
    spans = _ordered(spans_mm, "--spans")
    _above(spans, 0, "--spans", "mm between pillars")
    layers = math.ceil(height_mm / bead.layer_mm)
    if not 1 <= layers <= 200:
        raise UsageError(
            f"--height {height_mm:g} mm is {layers} layers of {bead.layer_mm:g} mm; take 1 to 200"
        )
    thick, row = 3 * bead.width_mm, _PILLAR_MM + 2.0
    size = (2 * MARGIN_MM + spans[-1] + 2 * thick, 2 * MARGIN_MM + len(spans) * row - 2.0)
    strokes, asked = frame(size, speed_mm_s), []
    feet = [
        (MARGIN_MM + side * (thick + span), MARGIN_MM + k * row)
        for k, span in enumerate(spans)
        for side in (0, 1)
    ]
    for layer in range(layers):
        for x, y in feet:
            strokes.append(_pillar(bead, x, y, layer * bead.layer_mm, speed_mm_s))
    for k, span in enumerate(spans):
        y = MARGIN_MM + k * row + _PILLAR_MM / 2
        path = [(MARGIN_MM, y), (MARGIN_MM + 2 * thick + span, y)]
        strokes.append(straight(k + 1, "bridge", path, speed_mm_s, z=layers * bead.layer_mm))
        asked.append(Question(k + 1, span))
    return Pattern("bridge", bead, size, tuple(strokes), tuple(asked))


def _pillar(bead: Bead, x: float, y: float, z: float, speed_mm_s: float) -> Stroke:
    """One layer: three lines side by side, to and fro."""
    path = []
    for k in range(3):
        ends = (y, y + _PILLAR_MM)[:: -1 if k % 2 else 1]
        path += [(x + (k + 0.5) * bead.width_mm, end) for end in ends]
    return straight(0, "pillar", path, speed_mm_s, z=z)


def _ordered(values: Sequence[float], option: str) -> list[float]:
    distinct = sorted(set(values))
    if len(distinct) < 2 or len(distinct) > MOST or not all(map(math.isfinite, distinct)):
        raise UsageError(f"{option} {list(values)}: give 2 to {MOST} different numbers")
    return distinct


def _above(values: list[float], limit: float, option: str, what: str) -> None:
    if values[0] <= limit:
        raise UsageError(f"{option} {values}: give numbers above {limit:g}, {what}")
