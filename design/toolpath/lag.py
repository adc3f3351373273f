"""Drive the plunger ahead of a flow that lags behind it, move by move.

For a linear ink τ dQ/dt = Q_in − Q (`docs/calibration.md`), so the flow Q that a path asks for
comes out if the plunger pushes Q + τ dQ/dt. Over a move of volume V that is V + τ (Q₁ − Q₀), Q₀ and
Q₁ the flows asked for at its ends; what is added over a whole stroke cancels but for the pressure
that the needle must have at its beginning and loses at its end, τ Q each. These two are pushed and
taken back while the needle stands, as fast as the plunger may: at a rate r it takes
t = −τ ln(1 − Q/r) to bring the flow to Q, and t = τ ln(1 + Q/r) to end it.

The plunger never goes back while the needle writes: where the flow asked for falls faster than the
pressure can, e^(−t/τ), it stands, and what is still too much is taken off the following moves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from design.toolpath.checks import require_positive
from design.toolpath.toolpath import FloatArray, IntArray, MoveKind, Toolpath

PER_LAG: Final = 4
"""Moves in a time constant where the flow changes."""
LEAST_MM: Final = 0.2
"""Shorter moves aren't made: a plunger's step is of that order."""
SAME: Final = 0.01
"""Flows of neighbours that differ by less need no more moves."""
MOST_OF_RATE: Final = 0.9
"""Of the plunger's rate that a flow may be; above, the pressure would take ever longer to build."""


@dataclass(frozen=True)
class Advanced:
    """A toolpath whose plunger is driven ahead.

    Attributes
    ----------
    toolpath : Toolpath
    primed_ul : float, µL
        Pushed before all strokes, to build the pressure.
    stood_ul : float, µL
        What the plunger couldn't take back at once, because it never goes back while writing.
    """

    toolpath: Toolpath
    primed_ul: float
    stood_ul: float


def advanced(toolpath: Toolpath, lag_s: float, rate_ul_s: float) -> Advanced:
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
    writes = fine.kind == MoveKind.WRITE
    same = writes[1:] & writes[:-1] & (fine.tool[1:] == fine.tool[:-1])
    first = np.flatnonzero(writes & ~np.concatenate([[False], same]))
    last = np.flatnonzero(writes & ~np.concatenate([same, [False]]))
    volume, stood = fine.volume_ul.copy(), 0.0
    flow = _flow(fine)
    before, after = np.zeros(len(first)), np.zeros(len(first))
    for number, (begin, end) in enumerate(zip(first, last + 1, strict=True)):
        ends = _at_ends(flow[begin:end], volume[begin:end])
        added, late = _forward(volume[begin:end], lag_s * np.diff(ends))
        volume[begin:end] = added
        stood += late
        before[number], after[number] = ends[0], ends[-1]
    changed = replace(fine, volume_ul=volume)
    prime = _prime_s(before, lag_s, rate_ul_s)
    relief = lag_s * np.log1p(after / rate_ul_s)
    stands = _with_stands(changed, first, last, prime, relief, rate_ul_s)
    return Advanced(stands, float((prime * rate_ul_s).sum()), stood)


def _flow(toolpath: Toolpath) -> FloatArray:
    """Asked for in each move, µL/s; 0 where the needle stands."""
    speed, length = toolpath.speed_mm_s, toolpath.lengths
    per_mm = np.divide(toolpath.volume_ul, length, out=np.zeros(len(length)), where=length > 0)
    return per_mm * speed


def _at_ends(flow: FloatArray, volume: FloatArray) -> FloatArray:
    """Flow at the ends of a stroke's moves, (n + 1,): between neighbours by their times."""
    lasts = volume / np.maximum(flow, 1e-12)
    inner = (flow[:-1] * lasts[1:] + flow[1:] * lasts[:-1]) / np.maximum(
        lasts[1:] + lasts[:-1], 1e-12
    )
    return np.concatenate([flow[:1], inner, flow[-1:]])


def _forward(volume: FloatArray, added: FloatArray) -> tuple[FloatArray, float]:
    """Volumes with what is added, none below 0: the rest goes on to the next; and how much did."""
    wanted = volume + added
    if (wanted >= 0).all():
        return wanted, 0.0
    found, owed, late = np.zeros(len(wanted)), 0.0, 0.0
    for k, value in enumerate(wanted):
        found[k] = max(value + owed, 0.0)
        owed = min(value + owed, 0.0)
        late = max(late, -owed)
    return found, late


def _prime_s(flow: FloatArray, lag_s: float, rate_ul_s: float) -> FloatArray:
    """How long the plunger pushes at its rate until so much flows, s."""
    share = np.minimum(flow / rate_ul_s, MOST_OF_RATE)
    return -lag_s * np.log1p(-share)


def _divided(toolpath: Toolpath, lag_s: float) -> Toolpath:
    """Writing moves cut in parts of a fraction of the lag where the flow changes."""
    flow, length = _flow(toolpath), toolpath.lengths
    writes = toolpath.kind == MoveKind.WRITE
    changes = np.abs(np.diff(flow)) > SAME * np.maximum(flow[1:], flow[:-1])
    near = writes & (np.concatenate([[False], changes]) | np.concatenate([changes, [False]]))
    lasts = np.divide(length, toolpath.speed_mm_s, out=np.zeros(len(length)), where=writes)
    wanted = np.ceil(np.minimum(lasts * PER_LAG / lag_s, length / LEAST_MM) - 1e-9)
    parts = np.where(near, np.maximum(wanted, 1), 1).astype(np.int64)
    of = np.repeat(np.arange(len(parts)), parts)
    number = np.arange(len(of)) - np.repeat(np.cumsum(parts) - parts, parts)
    rows = toolpath.where(of)
    way = rows.end - rows.start
    share = 1.0 / parts[of]
    begin = rows.start + (number * share)[:, None] * way
    end = np.where((number + 1 == parts[of])[:, None], rows.end, begin + share[:, None] * way)
    return replace(rows, start=begin, end=end, volume_ul=rows.volume_ul * share)


def _with_stands(
    toolpath: Toolpath,
    first: IntArray,
    last: IntArray,
    prime_s: FloatArray,
    relief_s: FloatArray,
    rate_ul_s: float,
) -> Toolpath:
    """Primes before the strokes and reliefs after them put in."""
    # A stroke's relief stands before the next one's prime where they meet.
    row = np.concatenate([last, first])
    place = np.concatenate([toolpath.end[last], toolpath.start[first]])
    lasts = np.concatenate([relief_s, prime_s])
    sign = np.concatenate([-np.ones(len(last)), np.ones(len(first))])
    kind = np.where(sign > 0, int(MoveKind.PRIME), int(MoveKind.RETRACT))
    at = np.concatenate([last + 1, first])
    return replace(
        toolpath,
        start=np.insert(toolpath.start, at, place, axis=0),
        end=np.insert(toolpath.end, at, place, axis=0),
        volume_ul=np.insert(toolpath.volume_ul, at, sign * lasts * rate_ul_s),
        speed_mm_s=np.insert(toolpath.speed_mm_s, at, 0.0),
        duration_s=np.insert(toolpath.duration_s, at, lasts),
        tool=np.insert(toolpath.tool, at, toolpath.tool[row]),
        kind=np.insert(toolpath.kind, at, kind),
        source=np.insert(toolpath.source, at, toolpath.source[row]),
    )
