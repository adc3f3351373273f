"""Unite ink that is written along older ink of the same layer: volumes add up.

The tip stands at the layer's height, so a line that is written over another one can't grow upwards:
its ink goes aside, and the line becomes as wide as one of both volumes (`BeadSection.width` of the
sum of their cross-sections). So a thin line is filled up by a second pass, and where a mend
overlaps sound ink it bulges.

Not modelled: what a needle drags along, lines that cross or lie beside each other (their ink is
united without a bulge), and how far fresh ink flows under the tip to both sides alike.
"""

from __future__ import annotations

from dataclasses import fields, replace
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from kernels.arrays import IntArray
from sim.gcode.deposit.levels import LEVEL_TOLERANCE_MM
from sim.gcode.deposit.strands import Strands

_STATION_MM: Final = 0.3
_SAME_MM: Final = 0.03
"""Distance of two axes that are one line: some motor steps."""
_PARALLEL: Final = 0.99
_LEAST_MM: Final = 0.02
"""Shorter overlaps aren't cut out: lines meet end to end."""


def united(strands: Strands) -> Strands:
    """Return layered strands in which what lies along older ink of its level holds both.

    Parameters
    ----------
    strands : Strands
        In the order of writing, each level's at one height.
    """
    pairs = _written_twice(strands) if len(strands) else np.zeros((0, 2), np.int64)
    if not len(pairs):
        return strands
    spans = np.array([_overlap(strands, old, new) for old, new in pairs.tolist()])
    real = (spans[:, 1] - spans[:, 0]) * strands.length[pairs[:, 0]] > _LEAST_MM
    pairs, spans = pairs[real], spans[real]
    cuts: dict[int, list[float]] = {}
    for (old, new), (a, b, c, d) in zip(pairs.tolist(), spans.tolist(), strict=True):
        cuts.setdefault(old, []).extend((a, b))
        cuts.setdefault(new, []).extend((c, d))
    pieces, of = _cut(strands, cuts)
    return _joined(pieces, of, pairs)


def _written_twice(strands: Strands) -> IntArray:
    """Pairs (k, 2) of an older and a newer strand that lie along each other somewhere."""
    length = strands.length
    count = np.maximum(1, np.ceil(length / _STATION_MM)).astype(np.int64)
    of = np.repeat(np.arange(len(count)), count)
    share = (np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[of]
    way = strands.end - strands.start
    place = strands.start[of] + share[:, None] * way[of]
    close = cKDTree(place).query_pairs(_STATION_MM / 2 + _SAME_MM, output_type="ndarray")
    close = close[strands.stroke[of[close[:, 0]]] != strands.stroke[of[close[:, 1]]]]
    old, new = of[close.min(axis=1)], of[close.max(axis=1)]
    along = way / np.maximum(length, 1e-12)[:, None]
    step = place[close.max(axis=1)] - place[close.min(axis=1)]
    aside = step - (step * along[old]).sum(axis=1)[:, None] * along[old]
    one_line = np.abs((along[old] * along[new]).sum(axis=1)) > _PARALLEL
    one_line &= np.linalg.norm(aside, axis=1) < _SAME_MM
    one_line &= np.abs(step[:, 2]) < LEVEL_TOLERANCE_MM
    return np.unique(np.column_stack([old, new])[one_line], axis=0)


def _overlap(strands: Strands, old: int, new: int) -> tuple[float, float, float, float]:
    """Shares of the older and of the newer strand between which they lie along each other."""
    begin, way = strands.start[old], strands.end[old] - strands.start[old]
    square = float(way @ way)
    ends = [float((end[new] - begin) @ way) / square for end in (strands.start, strands.end)]
    low, high = max(0.0, min(ends)), min(1.0, max(ends))
    if high <= low:
        return 0.0, 0.0, 0.0, 0.0
    shares = sorted((at - ends[0]) / (ends[1] - ends[0]) for at in (low, high))
    return low, high, shares[0], shares[1]


def _cut(strands: Strands, cuts: dict[int, list[float]]) -> tuple[Strands, IntArray]:
    """Strands cut at shares of their way, and which strand each piece is of."""
    of, shares = list[int](), list[tuple[float, float]]()
    length = strands.length
    for k in range(len(strands)):
        least = _LEAST_MM / 2 / max(float(length[k]), 1e-12)
        at = [0.0]
        for cut in sorted(cuts.get(k, ())):
            if at[-1] + least < cut < 1.0 - least:
                at.append(cut)
        at.append(1.0)
        of += [k] * (len(at) - 1)
        shares += pairwise(at)
    row, share = np.array(of), np.array(shares)
    chosen = Strands(**{item.name: getattr(strands, item.name)[row] for item in fields(Strands)})
    way = (strands.end - strands.start)[row]
    whole = (share[:, 1] - share[:, 0] == 1.0)[:, None]
    return replace(
        chosen,
        start=chosen.start + share[:, :1] * way,
        end=np.where(whole, chosen.end, chosen.start + share[:, 1:] * way),
        dose_ul=chosen.dose_ul * (share[:, 1] - share[:, 0]),
    ), row


def _joined(pieces: Strands, of: IntArray, pairs: IntArray) -> Strands:
    """Pieces whose ink lies along a newer one are left out; that one has it in addition."""
    area, dose = pieces.area_mm2.copy(), pieces.dose_ul.copy()
    middle, kept = (pieces.start + pieces.end) / 2, np.ones(len(of), dtype=np.bool_)
    first = np.searchsorted(of, np.arange(of.max() + 2))
    for old, new in pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].tolist():
        mine, its = slice(first[new], first[new + 1]), range(first[old], first[old + 1])
        for piece in its:
            away = np.linalg.norm(middle[mine] - middle[piece], axis=1)
            k = int(away.argmin())
            if kept[piece] and away[k] < 2 * _SAME_MM:
                kept[piece] = False
                area[first[new] + k] += area[piece]
                dose[first[new] + k] += dose[piece]
    chosen = replace(pieces, area_mm2=area, dose_ul=dose)
    return Strands(**{item.name: getattr(chosen, item.name)[kept] for item in fields(Strands)})
