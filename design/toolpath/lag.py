"""Compensate the ink's pressure lag in a toolpath by driving the plunger ahead, move by move.

For a linear ink τ dQ/dt = Q_in − Q (`docs/calibration.md`), so the flow Q that a path asks for
comes out if the plunger pushes Q + τ dQ/dt. Over a move of volume V that is V + τ (Q₁ − Q₀), Q₀ and
Q₁ the flows asked for at its ends; what is added over a whole stroke cancels but for the pressure
that the needle must have at its beginning and loses at its end, τ Q each. These two are pushed and
taken back while the needle stands, as fast as the plunger may, and so is a step of flow on the way:
at a rate r it takes t = τ ln((r − Q₀)/(r − Q₁)) to raise the flow, τ ln((r + Q₀)/(r + Q₁)) to lower
it.

The plunger never goes back while the needle writes: where the flow asked for falls faster than the
pressure can, e^(−t/τ), it stands, and what is still too much is taken off the following moves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from design.toolpath.toolpath import MoveKind, Toolpath, require_positive
from kernels.arrays import BoolArray, FloatArray, IntArray

PER_LAG: Final = 8
"""Moves in a time constant where the flow changes."""
LEAST_MM: Final = 0.15
"""Shorter moves aren't made: a plunger's step is of that order."""
SAME: Final = 0.01
"""Flows of neighbours that differ by less need no more moves."""
STEP: Final = 0.2
"""A change of flow between two moves by so much of the larger is made while the needle stands."""
MOST_OF_RATE: Final = 0.9
"""Of the plunger's rate that a flow may be; above, the pressure would take ever longer to build."""


@dataclass(frozen=True)
class AdvancedToolpath:
    """A toolpath whose plunger is driven ahead.

    Attributes
    ----------
    toolpath : Toolpath
    lag_s : float, s
    stood_ul : float, µL
        What the plunger couldn't take back at once, because it never goes back while writing.
    """

    toolpath: Toolpath
    lag_s: float
    stood_ul: float


def compensate_lag(toolpath: Toolpath, lag_s: float, rate_ul_s: float) -> AdvancedToolpath:
    """Compensate a lag along all strokes (runs of writing moves of one head).

    Parameters
    ----------
    toolpath : Toolpath
    lag_s : float, s
        τ.
    rate_ul_s : float, µL/s
        At which the plunger builds and takes back pressure while the needle stands.
    """
    require_positive("lag compensation", lag_s=lag_s, rate_ul_s=rate_ul_s)
    fine = _divided(toolpath, lag_s)
    flow, volume, stood = _flow(fine), fine.volume_ul.copy(), 0.0
    first, last, joined = _runs(fine, flow)
    begins, ends = np.zeros(len(first)), np.zeros(len(first))
    for number, (begin, end) in enumerate(zip(first, last + 1, strict=True)):
        at = _at_ends(flow[begin:end], volume[begin:end])
        volume[begin:end], late = _forward(volume[begin:end], lag_s * np.diff(at))
        stood += late
        begins[number], ends[number] = at[0], at[-1]
    # What flows before each run, and after it: nothing, but where the next one goes on at once.
    before = np.where(joined, np.concatenate([[0.0], ends[:-1]]), 0.0)
    stops = np.append(~joined[1:], True)
    stands = _Stands(
        np.concatenate([last[stops] + 1, first]),
        np.concatenate([last[stops], first]),
        np.concatenate([fine.end[last[stops]], fine.start[first]]),
        _pushed_s(
            np.concatenate([ends[stops], before]),
            np.concatenate([np.zeros(int(stops.sum())), begins]),
            lag_s,
            rate_ul_s,
        ),
    )
    changed = replace(fine, volume_ul=volume)
    return AdvancedToolpath(_with_stands(changed, stands, rate_ul_s), lag_s, stood)


@dataclass(frozen=True)
class _Stands:
    """Where the needle stands for the plunger: before which row, like which, where, how long.

    A time below 0 draws the plunger back.
    """

    at: IntArray
    row: IntArray
    place: FloatArray
    lasts_s: FloatArray


def _runs(toolpath: Toolpath, flow: FloatArray) -> tuple[IntArray, IntArray, BoolArray]:
    """First and last move of each run without a step of flow, and which follow another at once."""
    writes = toolpath.kind == MoveKind.WRITE
    follows = writes[1:] & writes[:-1] & (toolpath.tool[1:] == toolpath.tool[:-1])
    steps = np.abs(np.diff(flow)) > STEP * np.maximum(flow[1:], flow[:-1])
    within = follows & ~steps
    first = np.flatnonzero(writes & ~np.concatenate([[False], within]))
    last = np.flatnonzero(writes & ~np.concatenate([within, [False]]))
    return first, last, np.concatenate([[False], follows])[first]


def _flow(toolpath: Toolpath) -> FloatArray:
    """Asked for in each move, µL/s; 0 where the needle stands."""
    speed, length = toolpath.speed_mm_s, toolpath.lengths
    per_mm = np.divide(toolpath.volume_ul, length, out=np.zeros(len(length)), where=length > 0)
    return per_mm * speed


def _at_ends(flow: FloatArray, volume: FloatArray) -> FloatArray:
    """Flow at the ends of a run's moves, (n + 1,): between neighbours by their times."""
    lasts = volume / np.maximum(flow, 1e-12)
    both = np.maximum(lasts[1:] + lasts[:-1], 1e-12)
    inner = (flow[:-1] * lasts[1:] + flow[1:] * lasts[:-1]) / both
    return np.concatenate([flow[:1], inner, flow[-1:]])


def _forward(volume: FloatArray, added: FloatArray) -> tuple[FloatArray, float]:
    """Volumes with what is added, none below 0: the rest goes on to the next; and how much did."""
    wanted = volume + added
    if (wanted >= 0).all():
        return wanted, 0.0
    volumes, owed, late = np.zeros(len(wanted)), 0.0, 0.0
    for k, value in enumerate(wanted):
        volumes[k] = max(value + owed, 0.0)
        owed = min(value + owed, 0.0)
        late = max(late, -owed)
    return volumes, late


def _pushed_s(before: FloatArray, after: FloatArray, lag_s: float, rate_ul_s: float) -> FloatArray:
    """How long the plunger pushes, or draws (below 0), to bring one flow to another, s."""
    low, high = (np.minimum(flow / rate_ul_s, MOST_OF_RATE) for flow in (before, after))
    rises = lag_s * np.log((1 - low) / (1 - high))
    falls = lag_s * np.log((1 + high) / (1 + low))
    return np.where(after >= before, rises, falls)


def _divided(toolpath: Toolpath, lag_s: float) -> Toolpath:
    """Writing moves cut in parts of a fraction of the lag where the flow changes."""
    flow, length = _flow(toolpath), toolpath.lengths
    writes = toolpath.kind == MoveKind.WRITE
    changes = np.abs(np.diff(flow)) > SAME * np.maximum(flow[1:], flow[:-1])
    changes &= writes[1:] & writes[:-1]
    near = writes & (np.concatenate([[False], changes]) | np.concatenate([changes, [False]]))
    lasts = np.divide(length, toolpath.speed_mm_s, out=np.zeros(len(length)), where=writes)
    wanted = np.floor(np.minimum(lasts * PER_LAG / lag_s, length / LEAST_MM) + 1e-9)
    parts = np.where(near, np.maximum(wanted, 1), 1).astype(np.int64)
    of = np.repeat(np.arange(len(parts)), parts)
    number = np.arange(len(of)) - np.repeat(np.cumsum(parts) - parts, parts)
    rows = toolpath.where(of)
    way = rows.end - rows.start
    share = 1.0 / parts[of]
    begin = rows.start + (number * share)[:, None] * way
    end = np.where((number + 1 == parts[of])[:, None], rows.end, begin + share[:, None] * way)
    return replace(rows, start=begin, end=end, volume_ul=rows.volume_ul * share)


def _with_stands(toolpath: Toolpath, stands: _Stands, rate_ul_s: float) -> Toolpath:
    """Primes and retractions put in; a run's end before the next one's begin where they meet."""
    lasts = stands.lasts_s
    kept = np.flatnonzero(lasts != 0)
    at, row, lasts = stands.at[kept], stands.row[kept], lasts[kept]
    place = stands.place[kept]
    kind = np.where(lasts > 0, int(MoveKind.PRIME), int(MoveKind.RETRACT))
    return replace(
        toolpath,
        start=np.insert(toolpath.start, at, place, axis=0),
        end=np.insert(toolpath.end, at, place, axis=0),
        volume_ul=np.insert(toolpath.volume_ul, at, lasts * rate_ul_s),
        speed_mm_s=np.insert(toolpath.speed_mm_s, at, 0.0),
        duration_s=np.insert(toolpath.duration_s, at, np.abs(lasts)),
        tool=np.insert(toolpath.tool, at, toolpath.tool[row]),
        kind=np.insert(toolpath.kind, at, kind),
        source=np.insert(toolpath.source, at, toolpath.source[row]),
    )
