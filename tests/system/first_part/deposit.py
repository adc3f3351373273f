"""Ink that a G-code file deposits: round filaments, or lines with upright sides in layers."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CELL_MM = 0.4
"""Side of a bucket of the spatial index."""

EVEN_MM = 1.0
"""Ink and syringe give way: a shorter move gets the mean dose of so much path about its middle."""

MIN_DOSE_UL_MM = 1e-6
"""Less ink on a millimetre is a travel."""


@dataclass(frozen=True)
class Strokes:
    """Written moves in order, printer's frame."""

    start: Array
    end: Array
    volume_ul: Array
    line: NDArray[np.int64]
    """Line of the file, from 1."""

    def evened(self, stretch: NDArray[np.int64]) -> Strokes:
        """Return moves with doses evened out along each stretch without a retraction."""
        length = np.linalg.norm(self.end - self.start, axis=1)
        path, pushed = (np.concatenate([[0.0], np.cumsum(one)]) for one in (length, self.volume_ul))
        middle, half = (path[:-1] + path[1:]) / 2, np.maximum(length, EVEN_MM) / 2
        first = path[np.searchsorted(stretch, stretch)]
        last = path[np.searchsorted(stretch, stretch, side="right")]
        low, high = np.maximum(middle - half, first), np.minimum(middle + half, last)
        dose = (np.interp(high, path, pushed) - np.interp(low, path, pushed)) / (high - low)
        return replace(self, volume_ul=dose * length)


def read_strokes(
    text: str, bore_mm: float, step_mm: float = 0.0, plunger_step_mm: float = 0.0
) -> Strokes:
    """Return moves that push ink: absolute or relative X, Y, Z and E, G92, and arcs.

    X and Y are rounded to whole steps of ``step_mm``, and E to whole steps of the plunger.
    """
    area = math.pi * bore_mm**2 / 4
    place, plunger = [0.0, 0.0, 0.0], 0.0
    furthest, drawn_back = 0.0, 0  # what was drawn back comes out first
    absolute, absolute_e = True, True
    rows: list[tuple[Any, ...]] = []
    for number, raw in enumerate(text.splitlines(), 1):
        words = _words(raw)
        code = words.pop("", "")
        if code in ("G90", "G91"):
            absolute = absolute_e = code == "G90"
        elif code in ("M82", "M83"):
            absolute_e = code == "M82"
        elif code == "G92":
            place = [words.get(axis, old) for axis, old in zip("XYZ", place, strict=True)]
            if "E" in words:
                furthest += words["E"] - plunger
                plunger = words["E"]
        elif code in ("G0", "G1", "G2", "G3"):
            target = [
                old if axis not in words else words[axis] + (0.0 if absolute else old)
                for axis, old in zip("XYZ", place, strict=True)
            ]
            pushed_to = plunger
            if "E" in words:
                pushed_to = words["E"] + (0.0 if absolute_e else plunger)
            if plunger_step_mm:
                pushed_to = round(pushed_to / plunger_step_mm) * plunger_step_mm
            pushed = max(pushed_to - max(plunger, furthest), 0.0)
            drawn_back += pushed_to < plunger
            furthest, plunger = max(furthest, pushed_to), pushed_to
            path = [place, target] if code in ("G0", "G1") else _arc(place, target, words, code)
            lengths = [math.dist(a, b) for a, b in pairwise(path)]
            total = sum(lengths)
            if total > 0 and pushed * area / total > MIN_DOSE_UL_MM:
                for (a, b), length in zip(pairwise(path), lengths, strict=True):
                    rows.append((*a, *b, pushed * area * length / total, number, drawn_back))
            place = target
    table = np.array(rows, dtype=np.float64).reshape(-1, 9)
    if step_mm:
        for columns in ((0, 1), (3, 4)):
            table[:, columns] = np.round(table[:, columns] / step_mm) * step_mm
    line, stretch = table[:, 7:].astype(np.int64).T
    return Strokes(table[:, :3], table[:, 3:6], table[:, 6], line).evened(stretch)


def _words(raw: str) -> dict[str, Any]:
    line = raw.split(";")[0].strip().upper()
    if not line:
        return {}
    first, *rest = line.split()
    found: dict[str, Any] = {"": first}
    for word in rest:
        try:
            found[word[0]] = float(word[1:])
        except ValueError:
            continue
    return found


def _arc(
    start: list[float], end: list[float], words: dict[str, Any], code: str
) -> list[list[float]]:
    centre = (start[0] + words.get("I", 0.0), start[1] + words.get("J", 0.0))
    radius = math.hypot(start[0] - centre[0], start[1] - centre[1])
    first = math.atan2(start[1] - centre[1], start[0] - centre[0])
    sweep = math.atan2(end[1] - centre[1], end[0] - centre[0]) - first
    sweep %= 2 * math.pi
    if code == "G2":
        sweep -= 2 * math.pi
    steps = max(int(abs(sweep) * radius / 0.05), 1)
    return [
        [
            centre[0] + radius * math.cos(first + sweep * k / steps),
            centre[1] + radius * math.sin(first + sweep * k / steps),
            start[2] + (end[2] - start[2]) * k / steps,
        ]
        for k in range(steps + 1)
    ]


@dataclass(frozen=True)
class Deposit:
    """Ink as lines: round ones of radius ``ball``, or slabs of half sizes ``flat`` and ``ball``.

    Modelled: the dose of each move, evened out along the path. Not modelled: sagging, swelling.
    """

    start: Array
    end: Array
    flat: Array
    ball: Array
    heads: NDArray[np.int64]
    """First entry of each bucket in ``entries``."""
    entries: NDArray[np.int64]
    low: Array
    shape: NDArray[np.int64]
    line: NDArray[np.int64]

    def covers(self, points: Array, grow_mm: float = 0.0) -> NDArray[np.bool_]:
        """Return for each point whether it lies in ink, all ink thicker by ``grow_mm`` a side."""
        out = np.zeros(len(points), np.bool_)
        _covers(
            np.ascontiguousarray(points, np.float64), grow_mm, self.start, self.end, self.flat,
            self.ball, self.heads, self.entries, self.low, self.shape, out,
        )  # fmt: skip
        return out

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest corner of all ink."""
        reach = np.column_stack([self.flat + self.ball] * 2 + [self.ball])
        low = np.minimum(self.start, self.end) - reach
        high = np.maximum(self.start, self.end) + reach
        return low.min(axis=0), high.max(axis=0)


def filaments(strokes: Strokes, shift_mm: Iterable[float]) -> Deposit:
    """Return round filaments: volume over length is their section; the tip is at their middle."""
    length = np.linalg.norm(strokes.end - strokes.start, axis=1)
    radius = np.sqrt(strokes.volume_ul / length / math.pi)
    return _indexed(strokes, np.zeros(len(length)), radius, np.array(list(shift_mm)), 0.0)


def capsules(start: Array, end: Array, radius: Array) -> Deposit:
    """Return round pieces of given radii between places."""
    length = np.linalg.norm(end - start, axis=1)
    strokes = Strokes(start, end, np.pi * radius**2 * length, np.arange(len(start)))
    return filaments(strokes, (0, 0, 0))


def layers(strokes: Strokes, shift_mm: Iterable[float], height_mm: float) -> Deposit:
    """Return lines with upright sides, hung below the tip, of the mean width area / height."""
    length = np.linalg.norm(strokes.end - strokes.start, axis=1)
    flat = strokes.volume_ul / length / height_mm / 2
    ball = np.full(len(length), height_mm / 2)
    return _indexed(strokes, flat, ball, np.array(list(shift_mm)), height_mm / 2)


def _indexed(strokes: Strokes, flat: Array, ball: Array, shift: Array, drop: float) -> Deposit:
    start, end = strokes.start + shift, strokes.end + shift
    start[:, 2] -= drop
    end[:, 2] -= drop
    reach = flat + ball + 0.06
    low = np.minimum(start, end) - reach[:, None]
    high = np.maximum(start, end) + reach[:, None]
    origin = low.min(axis=0)
    shape = np.floor((high.max(axis=0) - origin) / CELL_MM).astype(np.int64) + 1
    first = np.floor((low - origin) / CELL_MM).astype(np.int64)
    last = np.floor((high - origin) / CELL_MM).astype(np.int64)
    counts = _fill(first, last, shape, np.zeros(0, np.int64), np.zeros(0, np.int64), False)
    heads = np.concatenate([[0], np.cumsum(counts)])
    entries = np.zeros(heads[-1], np.int64)
    _fill(first, last, shape, heads[:-1].copy(), entries, True)
    return Deposit(start, end, flat, ball, heads, entries, origin, shape, strokes.line)


@numba.njit(cache=True)
def _fill(first, last, shape, heads, entries, write):  # type: ignore[no-untyped-def]
    counts = np.zeros(shape[0] * shape[1] * shape[2], np.int64)
    for n in range(len(first)):
        for i in range(first[n, 0], last[n, 0] + 1):
            for j in range(first[n, 1], last[n, 1] + 1):
                for k in range(first[n, 2], last[n, 2] + 1):
                    cell = (i * shape[1] + j) * shape[2] + k
                    if write:
                        entries[heads[cell] + counts[cell]] = n
                    counts[cell] += 1
    return counts


@numba.njit(cache=True)
def _covers(points, grow, start, end, flat, ball, heads, entries, low, shape, out):  # type: ignore[no-untyped-def]
    for n in range(len(points)):
        x, y, z = points[n]
        i = int((x - low[0]) // CELL_MM)
        j = int((y - low[1]) // CELL_MM)
        k = int((z - low[2]) // CELL_MM)
        if not (0 <= i < shape[0] and 0 <= j < shape[1] and 0 <= k < shape[2]):
            continue
        cell = (i * shape[1] + j) * shape[2] + k
        for entry in range(heads[cell], heads[cell + 1]):
            m = entries[entry]
            dx, dy, dz = end[m, 0] - start[m, 0], end[m, 1] - start[m, 1], end[m, 2] - start[m, 2]
            px, py, pz = x - start[m, 0], y - start[m, 1], z - start[m, 2]
            share = (px * dx + py * dy + pz * dz) / max(dx * dx + dy * dy + dz * dz, 1e-18)
            share = min(max(share, 0.0), 1.0)
            ox, oy, oz = px - share * dx, py - share * dy, pz - share * dz
            reach = ball[m] + grow
            if flat[m] > 0.0:
                inside = math.hypot(ox, oy) <= flat[m] + grow and abs(oz) <= reach
            else:
                inside = ox * ox + oy * oy + oz * oz <= reach * reach
            if inside:
                out[n] = True
                break


def deposit_of(
    gcode: Path,
    shift_mm: Iterable[float],
    bore_mm: float,
    layer_mm: float | None,
    steps_per_mm: dict[str, float],
) -> Deposit:
    """Return the ink of a file, moved by ``shift_mm`` into the part's frame."""
    text, step_mm = gcode.read_text(), 1 / steps_per_mm["x"]
    if layer_mm is None:
        return filaments(read_strokes(text, bore_mm, step_mm, 1 / steps_per_mm["e"]), shift_mm)
    # A short line of a layer may get no whole step: over a millimetre they even out.
    return layers(read_strokes(text, bore_mm, step_mm), shift_mm, layer_mm)
