"""Insert dwells before strokes where the needle just passed, until the bath's crevice has closed.

A needle that moves through a yield-stress bath leaves a crevice, which closes within a time of the
bath's own. Ink written into an open one runs up along it. So before a pass the needle waits, above
what it is to write, until every place of the pass has been left by the shaft for that time.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.toolpath.toolpath import MoveKind, Toolpath
from kernels.arrays import FloatArray, IntArray

SAMPLES = 2.0
"""Places looked at for each radius of the shaft along a move."""


def add_recovery_dwells(toolpath: Toolpath, recovery_s: float, radius_mm: float) -> Toolpath:
    """The toolpath with dwells before the descents to passes in a fresh wake.

    Parameters
    ----------
    toolpath : Toolpath
        Of passes, between which the needle travels.
    recovery_s : float, s
        How long the bath takes to close.
    radius_mm : float, mm
        Of the widest shaft.
    """
    if recovery_s <= 0:
        return toolpath
    lasts = toolpath.duration_s + _moving_s(toolpath)
    begins = np.concatenate([[0.0], np.cumsum(lasts)[:-1]])
    places, moves, when = _sampled(toolpath, begins, lasts, radius_mm / SAMPLES)
    rows: list[int] = []
    waits: list[float] = []
    late = 0.0
    for last, first, end in _passes(toolpath):
        row = _descent(toolpath, last, first)
        begin, done, stop = np.searchsorted(moves, [row, first, end])
        when[begin:stop] += late  # the descent itself belongs to the pass
        oldest = np.searchsorted(when[:begin], when[done] - recovery_s)
        age = _age(places, when, slice(done, stop), slice(oldest, begin), radius_mm)
        if age < recovery_s:
            rows.append(row)
            waits.append(recovery_s - age)
            late += recovery_s - age
            when[begin:stop] += recovery_s - age
    return _with_dwells(toolpath, np.array(rows, dtype=np.int64), np.array(waits))


def _moving_s(toolpath: Toolpath) -> FloatArray:
    moves = toolpath.speed_mm_s > 0
    seconds = np.zeros(len(toolpath))
    seconds[moves] = toolpath.lengths[moves] / toolpath.speed_mm_s[moves]
    return seconds


def _sampled(
    toolpath: Toolpath, begins: FloatArray, lasts: FloatArray, step_mm: float
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Places of the tip (n, 3), the move of each, and when it is there, s."""
    count = np.maximum(np.ceil(toolpath.lengths / step_mm).astype(np.int64), 1) + 1
    moves = np.repeat(np.arange(len(toolpath)), count)
    share = np.arange(len(moves)) - np.repeat(np.cumsum(count) - count, count)
    share = share / (count[moves] - 1)
    way = toolpath.end - toolpath.start
    places = toolpath.start[moves] + share[:, None] * way[moves]
    return places, moves, begins[moves] + share * lasts[moves]


def _passes(toolpath: Toolpath) -> list[tuple[int, int, int]]:
    """Of each pass but the first: last move of the one before, its first, and the move after it."""
    writes = np.flatnonzero(toolpath.kind == MoveKind.WRITE)
    travels = np.concatenate([[0], np.cumsum(toolpath.kind == MoveKind.TRAVEL)])
    breaks = np.flatnonzero(np.diff(travels[writes]) > 0)
    firsts = writes[breaks + 1].tolist()
    ends = [*writes[breaks[1:]].tolist(), int(writes[-1])] if len(breaks) else []
    return [
        (int(writes[at]), first, end + 1)
        for at, first, end in zip(breaks.tolist(), firsts, ends, strict=True)
    ]


def _age(
    places: FloatArray, when: FloatArray, own: slice, before: slice, radius_mm: float
) -> float:
    """How long before its own writing the shaft last stood in a place of the pass, at least, s."""
    mine, others = places[own], places[before]
    away = np.hypot(mine[:, None, 0] - others[None, :, 0], mine[:, None, 1] - others[None, :, 1])
    swept = (away < radius_mm) & (others[None, :, 2] < mine[:, None, 2] + radius_mm)
    ages = when[own][:, None] - when[before][None]
    return float(np.where(swept, ages, np.inf).min(initial=np.inf))


def _descent(toolpath: Toolpath, last: int, first: int) -> int:
    """The move before which to wait: the first of those that go straight down to the pass."""
    row = first
    while row - 1 > last:
        way = toolpath.end[row - 1] - toolpath.start[row - 1]
        still = toolpath.kind[row - 1] != MoveKind.TRAVEL
        if not still and (way[2] >= 0 or way[:2].any()):
            break
        row -= 1
    return row


def _with_dwells(toolpath: Toolpath, rows: IntArray, waits: FloatArray) -> Toolpath:
    if not len(rows):
        return toolpath
    changed: dict[str, Any] = {}
    for field in fields(toolpath):
        values = getattr(toolpath, field.name)
        if isinstance(values, np.ndarray):
            more = _of_dwells(toolpath, field.name, rows, waits)
            changed[field.name] = np.insert(values, rows, more, axis=0)
    return replace(toolpath, **changed)


def _of_dwells(
    toolpath: Toolpath, name: str, rows: IntArray, waits: FloatArray
) -> NDArray[np.generic]:
    """What a dwell before each row holds."""
    if name in ("start", "end"):
        return toolpath.start[rows]
    if name == "duration_s":
        return waits
    if name == "kind":
        return np.full(len(rows), int(MoveKind.DWELL))
    if name in ("volume_ul", "speed_mm_s"):
        return np.zeros(len(rows))
    values: NDArray[np.generic] = getattr(toolpath, name)[rows]
    return values
