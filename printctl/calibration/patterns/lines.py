"""Calibration patterns for line width: lines at several speeds and flows, and a spiral."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from printctl.calibration.patterns.plan import MARGIN_MM, Bead, Pattern, Stroke, frame, straight
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
