"""Calibration patterns: lines, spiral, comb, joints, bridges and squares."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
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

MOST_LINES: Final = 60
_SPACING: Final = (6.0, 2.0)
"""Between lines: widths, and at least mm; a step's thick begin is twice as wide."""
_TURN_MM: Final = 0.3
"""Way of a spiral's moves."""


@dataclass(frozen=True)
class LineSeries:
    """Speeds, flows and other values varied in a pattern.

    Attributes
    ----------
    speeds_mm_s : sequence of float, mm/s
    flows : sequence of float
        Multiples of the cross-section.
    length_mm : float, mm
        Of a line.
    repeats : int
        Of each speed and flow.
    steps : int
        Lines that are written slow, fast, slow.
    seed : int
        Of the order of lines: a drift must not look like an effect of speed.
    """

    speeds_mm_s: Sequence[float]
    flows: Sequence[float]
    length_mm: float
    repeats: int = 1
    steps: int = 2
    seed: int = 0


def lines_pattern(bead: Bead, asked: LineSeries) -> Pattern:
    """Parallel lines along x, every second one written backwards; the order is shuffled.

    Raises
    ------
    UsageError
        For too many lines, speeds or flows that aren't above 0, or lines too short.
    """
    _check(bead, asked)
    plain = list(product(asked.speeds_mm_s, asked.flows)) * asked.repeats
    slow, fast = min(asked.speeds_mm_s), max(asked.speeds_mm_s)
    steps = asked.steps if fast > slow else 0
    jobs: list[tuple[float, float] | None] = [*plain, *([None] * steps)]
    order = np.random.default_rng(asked.seed).permutation(len(jobs))
    middle = float(np.median(asked.speeds_mm_s))
    spacing = max(_SPACING[0] * bead.width_mm, _SPACING[1])
    size = (asked.length_mm + 2 * MARGIN_MM, (len(jobs) - 1) * spacing + 2 * MARGIN_MM)
    strokes = frame(size, middle)
    for place, which in enumerate(order.tolist()):
        job = jobs[which]
        y = MARGIN_MM + place * spacing
        ends = np.array([MARGIN_MM, MARGIN_MM + asked.length_mm])[:: -1 if place % 2 else 1]
        if job is None:
            x = np.linspace(ends[0], ends[1], 4)
            speed = np.array([slow, fast, slow])
            strokes.append(straight(place + 1, "step", [(at, y) for at in x.tolist()], speed))
        else:
            path = [(at, y) for at in ends.tolist()]
            strokes.append(straight(place + 1, "line", path, job[0], job[1]))
    return Pattern("lines", bead, size, tuple(strokes))


def _check(bead: Bead, asked: LineSeries) -> None:
    for name, values in (("speeds", asked.speeds_mm_s), ("flow factors", asked.flows)):
        if not values or min(values) <= 0 or not all(map(math.isfinite, values)):
            raise UsageError(f"{name} {list(values)}: give numbers above 0")
    if max(asked.flows) > 3 or min(asked.flows) < 0.2:
        raise UsageError(
            f"flow factors {list(asked.flows)} aren't within 0.2 to 3: multiples of the line's "
            "cross-section, 1 for the line itself"
        )
    count = len(asked.speeds_mm_s) * len(asked.flows) * asked.repeats + asked.steps
    if count > MOST_LINES:
        raise UsageError(
            f"{count} lines, and a sheet holds {MOST_LINES}; take fewer speeds, flows or repeats"
        )
    if asked.length_mm < 20 * bead.width_mm:
        raise UsageError(
            f"a line of {asked.length_mm:g} mm is short for a width of {bead.width_mm:g} mm; take "
            f"{20 * bead.width_mm:g} mm or more (--length)"
        )


def spiral_pattern(bead: Bead, speed_mm_s: float, turns: float, pitch_mm: float) -> Pattern:
    """One line, from the inside out, r = r₀ + pitch θ/2π: long writing without a stop.

    Raises
    ------
    UsageError
        For turns that would touch.
    """
    if pitch_mm < 3 * bead.width_mm:
        raise UsageError(
            f"--pitch {pitch_mm:g} mm leaves turns of {bead.width_mm:g} mm no room to be told "
            f"apart; take {3 * bead.width_mm:g} mm or more"
        )
    first = 1.5 * pitch_mm
    last = first + turns * pitch_mm
    # Even steps of way: dL ≈ r dθ, so that L = (r² − r₀²) π/pitch.
    way = np.pi * (last**2 - first**2) / pitch_mm
    along = np.linspace(0, way, max(16, math.ceil(way / _TURN_MM)))
    radius = np.sqrt(first**2 + along * pitch_mm / np.pi)
    angle = (radius - first) * 2 * np.pi / pitch_mm
    middle = last + MARGIN_MM
    points = np.column_stack(
        [middle + radius * np.cos(angle), middle + radius * np.sin(angle), 0 * angle]
    )
    # Wider than high, so that a turned picture is told from an upright one.
    size = (2 * middle + MARGIN_MM, 2 * middle)
    written = Stroke(1, "spiral", points, np.full(len(points) - 1, speed_mm_s))
    return Pattern("spiral", bead, size, (*frame(size, speed_mm_s), written))


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


_OUTERMOST: Final = 0.9
"""Place of the lines beyond the squares, over the circle's radius."""
_INNERMOST: Final = 0.2
_APART: Final = (4.8, 0.2)
"""Between parallel lines: at least mm, so that each is alone within 2 mm of where it is looked for;
and over the radius."""
_LEAST_MM: Final = 16.0


def squares_pattern(bead: Bead, across_mm: float, speed_mm_s: float) -> Pattern:
    """Squares in a circle, and a line beyond each side: straight lines that don't meet.

    Each line of ink lies off by some 20 µm of its own, so what a camera is tied to by four sides of
    a small square is off by that, and by more where it is prolonged. Sixteen lines (fewer in a
    small dish) as far apart as the dish lets them bring it below that everywhere in the dish.

    Parameters
    ----------
    across_mm : float, mm
        Diameter of the circle.

    Raises
    ------
    UsageError
        For a circle so small that lines would touch.
    """
    if not math.isfinite(across_mm) or across_mm < _LEAST_MM:
        raise UsageError(
            f"--across {across_mm:g} mm leaves lines no room to be told apart; give "
            f"{_LEAST_MM:g} mm or more, as far as the dish lets the needle go"
        )
    radius = across_mm / 2
    away, apart = _OUTERMOST * radius, max(_APART[0], _APART[1] * radius)
    halves = np.arange(away - apart, _INNERMOST * radius, -apart)
    strokes = [_square(radius, half, speed_mm_s) for half in halves[::-1].tolist()]
    half = away * math.sqrt(1 - _OUTERMOST**2)
    for turn in range(4):
        ends = np.array([[away, -half], [away, half]]) @ _quarter(turn) + radius
        strokes.append(straight(0, "side", [(x, y) for x, y in ends.tolist()], speed_mm_s))
    return Pattern("squares", bead, (across_mm, across_mm), tuple(strokes))


def _square(radius: float, half: float, speed_mm_s: float) -> Stroke:
    corners = [(-half, half), (-half, -half), (half, -half), (half, half), (-half, half)]
    return straight(0, "side", [(radius + x, radius + y) for x, y in corners], speed_mm_s)


def _quarter(turns: int) -> np.ndarray:
    """Rotation by quarter turns, (2, 2), exact."""
    return np.linalg.matrix_power(np.array([[0.0, 1.0], [-1.0, 0.0]]), turns)
