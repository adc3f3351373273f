"""Build the playback data of a predicted print: all heads' deposited ink in order of time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gcode.bead.predict import swell
from gcode.deposit.written import written_levels
from kernels.arrays import FloatArray, IntArray
from printctl.checks.bead.predict import InkPrediction
from printctl.checks.bead.vessels import VesselDiameters
from report.gcode import Act
from report.play import Playback, PlayNote, PlayRows, thin_playback

DROP_UL: Final = 1e-3
"""Less ink in one place while the needle stands is no drop; a nanolitre is 0.12 mm wide."""
_WAY_MM: Final = 1e-9
_ROUNDED_MM: Final = 1e-4


def make_playback(
    all_heads: Sequence[InkPrediction],
    facts: Sequence[Mapping[str, Any]],
    vessels: Mapping[int, VesselDiameters],
    remarks: Sequence[tuple[int, str]] = (),
) -> Playback:
    """Return the playback data of a prediction, thinned for the page.

    Parameters
    ----------
    all_heads : sequence of InkPrediction
    facts : sequence of mapping
        `prediction_facts` of each; their warnings are shown.
    vessels : mapping of head to VesselDiameters
        Against the design; empty where the network isn't known. Then the widths are held against
        what the file asks for.
    remarks : sequence of (int, str)
        Further warnings: line, 0 for none, and text.
    """
    embedded = any(one.bead.style == "embedded" for one in all_heads)
    every = [_rows(one, vessels.get(one.head), len(all_heads) > 1) for one in all_heads]
    rows, laid = _in_time(every)
    rows = replace(rows, laid_ul=np.cumsum(laid))
    stroke = _strokes(all_heads, every, rows)
    layer, z = _passes(rows, stroke) if embedded else _levels(rows)
    rows = replace(rows, layer=layer)
    inks = [""] * (1 + max(one.head for one in all_heads))
    for one in all_heads:
        name = one.mounting.ink.name
        inks[one.head] = f"head {one.head}: {name}" if len(all_heads) > 1 else name
    whole = Playback(
        rows,
        embedded,
        z,
        tuple(inks),
        "the design" if vessels else "the file's E",
        (*_remarks(remarks, rows), *_warnings(all_heads, facts, rows)),
        tuple(_notes(all_heads, bool(vessels))),
    )
    return thin_playback(whole)


def _rows(one: InkPrediction, held: VesselDiameters | None, several: bool) -> PlayRows:
    """One head's pieces; ink of those that are left out is laid by the one before."""
    bead, pieces = one.bead, one.bead.pieces
    moves = pieces.length > _WAY_MM
    laid = bead.flow.laid_ul
    act = np.where(bead.writes, Act.WRITE, Act.TRAVEL).astype(np.uint8)
    act[~moves & (laid > DROP_UL)] = Act.PRIME
    factor = swell(one.mounting.ink)[0] if bead.style == "embedded" else 1.0
    wide = np.where(moves & bead.lays, bead.width_mm * factor, np.nan)
    rows = PlayRows(
        pieces.start,
        pieces.end,
        pieces.time[:-1],
        pieces.time[1:],
        act,
        laid,
        wide,
        _wanted(one, held),
        bead.line,
        one.source if one.of_vessels else np.full(len(bead), -1),
        np.full(len(bead), one.head),
        bead.stroke,
    )
    # Where another head may be in use, this one's rests are none of the needle's.
    return _without(rows, pieces.block < 0) if several else rows


def _without(rows: PlayRows, left_out: NDArray[np.bool_]) -> PlayRows:
    kept = ~left_out
    if not kept.any():
        return rows
    laid = np.zeros(len(rows))
    before = np.maximum.accumulate(np.where(kept, np.arange(len(rows)), int(kept.argmax())))
    np.add.at(laid, before, rows.laid_ul)
    return replace(rows, laid_ul=laid).taken(kept)


def _wanted(one: InkPrediction, held: VesselDiameters | None) -> FloatArray:
    """Width that each piece is to have, (n,), mm; NaN where nobody says it."""
    if held is not None:
        return held.piece_mm
    bead, asked = one.bead, one.asked_mm2
    if bead.style == "embedded":
        return np.sqrt(4 / np.pi * asked)
    height = np.divide(
        bead.area_mm2, bead.width_mm, out=np.full(len(bead), np.nan), where=bead.width_mm > 0
    )
    return asked / height


def _in_time(every: Sequence[PlayRows]) -> tuple[PlayRows, FloatArray]:
    """All heads' rows by time, from 0; and the ink of each."""
    names = PlayRows.__dataclass_fields__
    whole = PlayRows(**{name: np.concatenate([getattr(r, name) for r in every]) for name in names})
    rows = whole.taken(np.argsort(whole.begin_s, kind="stable"))
    zero = float(rows.begin_s[0])
    rows = replace(rows, begin_s=rows.begin_s - zero, end_s=rows.end_s - zero)
    return rows, rows.laid_ul


def _strokes(
    all_heads: Sequence[InkPrediction], every: Sequence[PlayRows], rows: PlayRows
) -> IntArray:
    """Number of the path that each row belongs to; no two heads share one."""
    past = np.cumsum([0, *(int(one.layer.max(initial=0)) + 1 for one in every)])
    place = {one.head: k for k, one in enumerate(all_heads)}
    return rows.layer + past[[place[head] for head in rows.head.tolist()]]


def _passes(rows: PlayRows, stroke: IntArray) -> tuple[IntArray, FloatArray]:
    """Number of the pass of each row, counted in time, and the highest place of each."""
    return _runs(rows, stroke[rows.act == Act.WRITE])


def _levels(rows: PlayRows) -> tuple[IntArray, FloatArray]:
    """Number of the layer of each row, counted in time, and its height."""
    z = rows.end[rows.act == Act.WRITE, 2]
    return _runs(rows, np.searchsorted(written_levels(z), z + _ROUNDED_MM, side="right"))


def _runs(rows: PlayRows, group: IntArray) -> tuple[IntArray, FloatArray]:
    """Runs of written rows of one group; what is between belongs to the next of them."""
    written = np.flatnonzero(rows.act == Act.WRITE)
    number = np.cumsum(np.diff(group, prepend=group[0]) != 0)
    top = np.full(int(number[-1]) + 1, -np.inf)
    np.maximum.at(top, number, np.maximum(rows.start[written, 2], rows.end[written, 2]))
    at = np.minimum(np.searchsorted(written, np.arange(len(rows))), len(written) - 1)
    return number[at].astype(np.int64), top


def _warnings(
    all_heads: Sequence[InkPrediction], facts: Sequence[Mapping[str, Any]], rows: PlayRows
) -> list[PlayNote]:
    notes = []
    for one, own in zip(all_heads, facts, strict=True):
        head = f"head {one.head}: " if len(all_heads) > 1 else ""
        for warning in own["warnings"]:
            sure = "" if warning["calibrated"] else " (uncalibrated)"
            line = int(warning["line"])
            time = _done_s(rows, line, rows.head == one.head)
            notes.append(PlayNote(f"{head}{warning['text']}{sure}", line, time))
    return notes


def _remarks(remarks: Sequence[tuple[int, str]], rows: PlayRows) -> list[PlayNote]:
    return [PlayNote(text, line, _done_s(rows, line)) for line, text in remarks]


def _done_s(rows: PlayRows, line: int, those: NDArray[np.bool_] | bool = True) -> float | None:
    """When a line is done, s: what it warns of then lies there; None where it moves nothing."""
    at = np.flatnonzero((rows.line == line) & those & (line > 0))
    return float(rows.end_s[at[-1]]) if len(at) else None


def _notes(all_heads: Sequence[InkPrediction], designed: bool) -> list[str]:
    if designed:
        against = (
            "Widths are held against the designed vessels; in joints and overlaps, and along "
            "travels, there is nothing to hold them against."
        )
    else:
        against = (
            "Widths are held against the E of the file's lines, not against the designed vessels."
        )
    unknown = any(one.lag.how == "unknown" for one in all_heads)
    lag = "Flow is predicted without a lag, which nobody measured. " if unknown else ""
    return [lag + against]
