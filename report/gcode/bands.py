"""Compute outline polygons of printed lines for a layer picture: true width, rounded ends.

Pieces of a run that have the same colour become one outline, filled as a union (non-zero winding),
so that a translucent colour lies once on each spot of it and twice only where two lines overlap.
Between two colours of one run neither has a round end, or the joint would look like an overlap.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from matplotlib.path import Path as Outline
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray

_ARC: Final = math.pi / 8
_STRAIGHT: Final = 1e-3


def band_outlines(
    start: FloatArray, end: FloatArray, width: FloatArray, run: IntArray, colour: IntArray
) -> tuple[list[Outline], IntArray]:
    """Outlines of lines of several runs, and the colour of each outline.

    Parameters
    ----------
    start, end : (n, 2) float64, mm
    width : (n,) float64, mm
    run : (n,) int64
        A piece joins the one before it where both are of one run.
    colour : (n,) int64
        A piece is in one outline with the one before it where run and colour are the same.
    """
    outlines, colours = [], []
    joins = np.concatenate([[False], np.diff(run) == 0])
    breaks = np.flatnonzero(~joins | (np.diff(colour, prepend=-1) != 0))
    for first, last in zip(breaks, np.append(breaks[1:], len(start)), strict=True):
        parts = _parts(start, end, width, joins, int(first), int(last))
        outlines.append(_outline(parts))
        colours.append(int(colour[first]))
    return outlines, np.array(colours, np.int64)


def _parts(
    start: FloatArray,
    end: FloatArray,
    width: FloatArray,
    joins: NDArray[np.bool_],
    first: int,
    last: int,
) -> list[FloatArray]:
    """Polygons, all counter-clockwise, whose union is the band."""
    parts = []
    for i in range(first, last):
        (x0, y0), (x1, y1), half = start[i], end[i], float(width[i]) / 2
        angle = math.atan2(y1 - y0, x1 - x0)
        across = half * np.array([-math.sin(angle), math.cos(angle)])
        parts.append(np.array([start[i] - across, end[i] - across, end[i] + across,
                               start[i] + across]))  # fmt: skip
        if not joins[i]:
            parts.append(_sector(start[i], half, angle + math.pi / 2, math.pi))
        else:
            before = end[i - 1] - start[i - 1]
            parts += _corner(start[i], half, math.atan2(before[1], before[0]), angle)
        if i + 1 == len(start) or not joins[i + 1]:
            parts.append(_sector(end[i], half, angle - math.pi / 2, math.pi))
    return parts


def _corner(at: FloatArray, half: float, before: float, after: float) -> list[FloatArray]:
    """The outer side of a turn."""
    turn = (after - before + math.pi) % (2 * math.pi) - math.pi
    if abs(turn) < _STRAIGHT:
        return []
    begin = before - math.pi / 2 if turn > 0 else after + math.pi / 2
    return [_sector(at, half, begin, abs(turn))]


def _sector(at: FloatArray, radius: float, begin: float, span: float) -> FloatArray:
    angles = begin + np.linspace(0.0, span, max(2, math.ceil(span / _ARC) + 1))
    arc = at + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    return np.vstack([at[None, :], arc])


def _outline(parts: list[FloatArray]) -> Outline:
    vertices, codes = [], []
    for part in parts:
        vertices += [part, part[:1]]
        codes += [Outline.MOVETO, *[Outline.LINETO] * (len(part) - 1), Outline.CLOSEPOLY]
    return Outline(np.vstack(vertices), codes)
