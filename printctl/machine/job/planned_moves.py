"""Moves of a few job lines as a planner sees them: length, step events, speed limits, corners.

Pure Python, for the link process: the compiled planner (`sim.gcode.motion.planner`) is the dry
run's.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from firmware_profiles import Printer
from printctl.machine.job.coordinates import Modal, declared_axes
from sim.gcode.reading import GcodeLine, is_motion, read_sent

_AXES: Final = "XYZE"
FAR_MM: Final = 1000.0
"""Length of a move on an axis whose place nobody has told before: as long as any."""
ARC_PIECE_MM: Final = 1.0
"""Length of an arc's pieces, each a block of the planner (Marlin's MAX_ARC_SEGMENT_MM)."""
ARC_PIECES_PER_TURN: Final = 72
"""At the least, so that small arcs have shorter ones (MIN_CIRCLE_SEGMENTS)."""
_STRAIGHT: Final = 0.999999
"""Cosine of an angle from which on a corner counts as none, or as a way straight back."""


@dataclass(frozen=True)
class PlannedMove:
    """One straight move, or piece of an arc.

    Attributes
    ----------
    line : int
        Of the job, from 0.
    length_mm : float
        Path of the tip, or of the plunger where that moves alone.
    events : float
        Steps of the motor that makes the most of them.
    top_mm_s : float
        Speed along the path by feed rate, motors' limits, and an arc's radius.
    acceleration_mm_s2 : float
        Along the path.
    way : (4,) tuple of float
        Unit vector of its direction, X Y Z E.
    """

    line: int
    length_mm: float
    events: float
    top_mm_s: float
    acceleration_mm_s2: float
    way: tuple[float, ...]


def planned_moves(
    lines: Sequence[bytes], first: int, end: int, at: Modal, printer: Printer
) -> list[PlannedMove]:
    """Return the moves of ``lines[first:end]``.

    Parameters
    ----------
    lines : sequence of bytes
        The job's, absolute throughout.
    first, end : int
    at : Modal
        Place and feed rate before ``first``.
    printer : Printer
    """
    return list(_moves(lines, first, end, at, printer))


def _moves(
    lines: Sequence[bytes], first: int, end: int, at: Modal, printer: Printer
) -> Iterator[PlannedMove]:
    place = {axis.upper(): mm for axis, mm in at.place().items()}
    feed = at.f
    for index in range(first, end):
        line = read_sent(lines[index])
        told = {axis: mm for axis in _AXES if (mm := line.number(axis)) is not None}
        feed = line.number("F") or feed
        if is_motion(lines[index]):
            way = [told[axis] - place.get(axis, told[axis] - FAR_MM) if axis in told else 0.0
                   for axis in _AXES]  # fmt: skip
            speed = printer.max_speed_mm_s.x if feed is None else feed / 60.0
            for piece, top in _pieces(line, way, speed, printer):
                yield _move(index, piece, top, printer)
        if is_motion(lines[index]) or line.code == "G92":
            place |= told
        else:
            place |= declared_axes(lines[index])


def _pieces(
    line: GcodeLine, way: Sequence[float], feed_mm_s: float, printer: Printer
) -> Iterator[tuple[Sequence[float], float]]:
    """Return the straight pieces of a line, mm in X Y Z E, with their greatest speed, mm/s."""
    if line.code not in ("G2", "G3"):
        if any(way):
            yield way, feed_mm_s
        return
    i, j = _centre(line, way)
    radius, begin = math.hypot(i, j), math.atan2(-j, -i)
    turn = math.atan2(way[1] - j, way[0] - i) - begin
    turn = turn % math.tau or math.tau
    turn -= math.tau if line.code == "G2" else 0.0
    least = math.ceil(ARC_PIECES_PER_TURN * abs(turn) / math.tau)
    count = max(math.ceil(radius * abs(turn) / ARC_PIECE_MM), least, 1)
    top = min(feed_mm_s, math.sqrt(printer.acceleration_mm_s2 * radius))
    angles = [begin + turn * k / count for k in range(count + 1)]
    for a, b in pairwise(angles):
        x, y = radius * (math.cos(b) - math.cos(a)), radius * (math.sin(b) - math.sin(a))
        yield (x, y, way[2] / count, way[3] / count), top


def _centre(line: GcodeLine, way: Sequence[float]) -> tuple[float, float]:
    """Return an arc's centre as seen from its begin, mm."""
    told = line.number("R")
    if told is None:
        return line.number("I") or 0.0, line.number("J") or 0.0
    x, y = way[0], way[1]
    chord_sq = max(x * x + y * y, 1e-12)
    height = math.sqrt(max(told * told / chord_sq - 0.25, 0.0))
    side = height if (line.code == "G3") == (told > 0) else -height
    return x / 2 - side * y, y / 2 + side * x


def _move(index: int, way: Sequence[float], feed_mm_s: float, printer: Printer) -> PlannedMove:
    length = max(math.hypot(*way[:3]) or abs(way[3]), 1e-6)
    motors = [abs(mm) / length for mm in way]
    speeds = [speed for _, speed in printer.max_speed_mm_s]
    most = [one for _, one in printer.max_acceleration_mm_s2]
    steps = [count * abs(mm) for (_, count), mm in zip(printer.steps_per_mm, way, strict=True)]
    size = math.hypot(*way) or 1.0
    return PlannedMove(
        line=index,
        length_mm=length,
        events=max(steps),
        top_mm_s=min([feed_mm_s, *_shared(speeds, motors)]),
        acceleration_mm_s2=min([printer.acceleration_mm_s2, *_shared(most, motors)]),
        way=tuple(mm / size for mm in way),
    )


def _shared(limits: Sequence[float], motors: Sequence[float]) -> list[float]:
    """Return motors' limits along the path, of those that move."""
    return [limit / share for limit, share in zip(limits, motors, strict=True) if share > 0.0]


def corner_mm_s(before: PlannedMove, after: PlannedMove, printer: Printer) -> float:
    """Return the speed at the corner of two moves, mm/s: Marlin's junction deviation.

    v² = a d s / (1 - s) with the deviation d and s = sin(θ/2) (Sonny Jeon's centripetal model, as
    in Grbl and Marlin, and `sim.gcode.motion.planner.junction_sq`); small segments' rule left out.
    """
    top = min(before.top_mm_s, after.top_mm_s)
    cosine = -sum(a * b for a, b in zip(before.way, after.way, strict=True))
    if cosine > _STRAIGHT:
        return 0.0
    half_sine = math.sqrt(0.5 * (1.0 - max(cosine, -_STRAIGHT)))
    acceleration = min(before.acceleration_mm_s2, after.acceleration_mm_s2)
    speed_sq = acceleration * printer.junction_deviation_mm * half_sine / (1.0 - half_sine)
    return min(top, math.sqrt(speed_sq))
