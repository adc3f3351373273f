"""Reduce a predicted print's playback data by joining moves within display accuracy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.gcode_job import Act
from report.play.playback import Playback, PlayRows
from report.wording import number

MOST_ROWS: Final = 400_000
"""Of a layered job in a page: about three megabytes."""
MOST_PASS_ROWS: Final = 40_000
"""Of passes, which are drawn all at once."""
_WAY_SHARE: Final = 1 / 4000
"""Of the job's extent: a quarter of a pixel in a picture 1,000 wide."""
_PLACE_SHARE: Final = 1 / 1000
_WIDTH_SHARE: Final = 0.01
_COARSER_AT_MOST: Final = 12
_SLIGHT: Final = 0.002
"""Of the stretches: a round that joins fewer is the last."""
_S: Final = 2e-6
"""Of time, and in mm of way, that is rounding."""


@dataclass(frozen=True)
class Limits:
    """How far what is shown may be from what is predicted.

    Attributes
    ----------
    way_mm : float, mm
        Of the needle's way.
    place_mm : float, mm
        Of the needle at any moment.
    width_mm : float, mm
        Between the least and the largest width that are told as one.
    by_line : bool
        Whether only what one line of the file writes is joined.
    """

    way_mm: float
    place_mm: float
    width_mm: float
    by_line: bool = False

    def coarser(self) -> Limits:
        """All of them twice as wide."""
        return Limits(2.0 * self.way_mm, 2.0 * self.place_mm, 2.0 * self.width_mm)

    def of_lines(self) -> Limits:
        """Any width within one line of the file."""
        return Limits(self.way_mm, self.place_mm, np.inf, True)


@dataclass
class _State:
    """Rows while they are joined, with how far each is from what it stands for."""

    rows: PlayRows
    way_off: FloatArray
    place_off: FloatArray
    low: FloatArray
    high: FloatArray
    area: FloatArray
    length: FloatArray


def thin_playback(played: Playback, most: int | None = None) -> Playback:
    """Join stretches, so that at most ``most`` remain; a note says how far they are off.

    Parameters
    ----------
    played : Playback
    most : int, optional
        `MOST_ROWS` or `MOST_PASS_ROWS` by default. Of a layered job with more each line of the file
        is then told by its mean width, and if that doesn't do, whole layers are left out, which the
        note says; passes are drawn ever coarser.
    """
    allowed = most or (MOST_PASS_ROWS if played.passes else MOST_ROWS)
    limits = usual_limits(played.rows)
    rows = join_stretches(played.rows, limits)
    if len(rows) > allowed and not played.passes:
        limits = limits.of_lines()
        rows = join_stretches(rows, limits)
    for _ in range(_COARSER_AT_MOST if played.passes else 0):
        if len(rows) <= allowed:
            break
        limits = limits.coarser()
        rows = join_stretches(rows, limits)
    every = 1
    if len(rows) > allowed and not played.passes:
        every = -(-len(rows) // allowed)
        rows = rows.taken(rows.layer % every == 0)
    if len(rows) == len(played.rows):
        return played
    return replace(played, rows=rows, notes=(*played.notes, _said(played, rows, limits, every)))


def usual_limits(rows: PlayRows) -> Limits:
    """Limits that follow from the job's extent and its usual width."""
    ends = np.concatenate([rows.start, rows.end])[np.tile(rows.act == Act.WRITE, 2)]
    extent = float(np.ptp(ends, axis=0).max()) if len(ends) else 1.0
    written = rows.width_mm[(rows.act == Act.WRITE) & ~np.isnan(rows.width_mm)]
    usual = float(np.median(written)) if len(written) else 0.0
    return Limits(extent * _WAY_SHARE, extent * _PLACE_SHARE, usual * _WIDTH_SHARE)


def _said(played: Playback, rows: PlayRows, limits: Limits, every: int) -> str:
    widths = f"that differ by less than {number(limits.width_mm * 1e3, 2)} µm as one"
    if limits.by_line:
        widths = "as the mean of each line of the file"
    layers = "" if every == 1 else f" One layer in {every} is drawn."
    return (
        f"{number(len(played.rows))} stretches of the prediction are drawn as {number(len(rows))}: "
        f"lines to {number(limits.way_mm * 1e3, 2)} µm, the needle's place to "
        f"{number(limits.place_mm * 1e3, 2)} µm, widths {widths}.{layers} No number of the report "
        "comes from them."
    )


def join_stretches(rows: PlayRows, limits: Limits) -> PlayRows:
    """Join neighbours of one kind as long as `limits` allow it.

    Joining goes in pairs, so that a straight way of n stretches takes log2 n rounds; what a joined
    stretch is off at most is the sum along its way, an upper bound.
    """
    wide = rows.width_mm
    none = np.zeros(len(rows))
    state = _State(rows, none, none, wide, wide, wide * rows.way_mm, rows.way_mm)
    while True:
        before = len(state.rows)
        for first in (0, 1):
            state = _round(state, limits, first)
        if len(state.rows) > (1 - _SLIGHT) * before:
            break
    length = np.maximum(state.length, 1e-12)
    width = np.where(state.length > _S, state.area / length, state.rows.width_mm)
    return replace(state.rows, width_mm=width)


def _round(state: _State, limits: Limits, first: int) -> _State:
    rows = state.rows
    a = np.arange(first, len(rows) - 1, 2)
    b = a + 1
    way, place = _off(rows, a, b)
    way += np.maximum(state.way_off[a], state.way_off[b])
    place += np.maximum(state.place_off[a], state.place_off[b])
    low, high = np.fmin(state.low[a], state.low[b]), np.fmax(state.high[a], state.high[b])
    fits = _alike(rows, a, b) & (way <= limits.way_mm) & (place <= limits.place_mm)
    fits &= ~(high - low > limits.width_mm)
    if limits.by_line:
        fits &= rows.line[a] == rows.line[b]
    a, b = a[fits], b[fits]
    whole = {name: getattr(state, name).copy() for name in _COLUMNS}
    whole["way_off"][a], whole["place_off"][a] = way[fits], place[fits]
    whole["low"][a], whole["high"][a] = low[fits], high[fits]
    whole["area"][a] += whole["area"][b]
    whole["length"][a] += whole["length"][b]
    kept = np.ones(len(rows), bool)
    kept[b] = False
    end, end_s, laid = rows.end.copy(), rows.end_s.copy(), rows.laid_ul.copy()
    end[a], end_s[a], laid[a] = end[b], end_s[b], laid[b]
    fewer = replace(rows, end=end, end_s=end_s, laid_ul=laid).taken(kept)
    return _State(fewer, **{name: column[kept] for name, column in whole.items()})


_COLUMNS: Final = ("way_off", "place_off", "low", "high", "area", "length")


def _alike(rows: PlayRows, a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether one goes on where and when the other ends, for the same."""
    alike = (np.abs(rows.end[a] - rows.start[b]) < _S).all(axis=1)
    alike &= np.abs(rows.end_s[a] - rows.begin_s[b]) < _S
    for kind in (rows.act, rows.vessel, rows.head, rows.layer):
        alike &= kind[a] == kind[b]
    for width in (rows.width_mm, rows.wanted_mm):
        alike &= np.isnan(width[a]) == np.isnan(width[b])
    known = ~np.isnan(rows.wanted_mm[a])
    apart = np.abs(rows.wanted_mm[a] - rows.wanted_mm[b]) > _WIDTH_SHARE * rows.wanted_mm[a]
    return np.asarray(alike & ~(known & apart))


def _off(
    rows: PlayRows, a: NDArray[np.int64], b: NDArray[np.int64]
) -> tuple[FloatArray, FloatArray]:
    """How far the place between two stretches is from the straight way past it: at all, and then.

    Returns
    -------
    way, place : (k,) float64, mm
    """
    begin, middle, end = rows.start[a], rows.end[a], rows.end[b]
    step = end - begin
    size = np.maximum((step**2).sum(axis=1), 1e-18)
    near = np.clip(((middle - begin) * step).sum(axis=1) / size, 0.0, 1.0)
    lasts = np.maximum(rows.end_s[b] - rows.begin_s[a], 1e-12)
    then = (rows.end_s[a] - rows.begin_s[a]) / lasts
    way, place = (
        np.linalg.norm(begin + share[:, None] * step - middle, axis=1) for share in (near, then)
    )
    return way, place
