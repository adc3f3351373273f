"""Sample a final scan for ink along a job's lines; compare with what print inspections saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from kernels.arrays import FloatArray, IntArray
from printctl.machine.job.job import Insert
from printctl.observe.records import LookRecord
from printctl.pipeline.judging.tracing import Job, layer_tops

WRITTEN: Final = "written_in_scan.npz"
_STEP_MM: Final = 0.05
_LEAST_SEEN: Final = 0.5
"""Share of a look's way below which look or scan says nothing of it."""
_PLENTY: Final = 0.95
"""Share of ink below which a look's own figure speaks against what it said."""


@dataclass(frozen=True)
class WrittenPlaces:
    """Places in the middle of what a job should have laid, in the order of writing.

    Attributes
    ----------
    at_mm : (p, 3) float64, mm
        Part frame, as designed.
    length_mm : (p,) float64, mm
        Of the piece of way that each stands for.
    line : (p,) int64
        Of the G-code file, from 1.
    stroke : (p,) int64
        Which unbroken line each is of.
    """

    at_mm: FloatArray
    length_mm: FloatArray
    line: IntArray
    stroke: IntArray


def written_places(job: Job, layered: bool) -> WrittenPlaces:
    """Return a place every 0.05 mm along a job's lines, in the middle of each one's height.

    Parameters
    ----------
    job : Job
    layered : bool
        Lines hang from the tip, one layer high; filaments in a bath lie around its way.
    """
    moves = job.moves
    length = np.linalg.norm(moves.end - moves.start, axis=1)
    count = np.maximum(np.ceil(length / _STEP_MM).astype(np.int64), 1)
    move = np.repeat(np.arange(len(count)), count)
    order = np.arange(len(move)) - np.repeat(np.cumsum(count) - count, count)
    share = (order + 0.5) / count[move]
    at = moves.start[move] + share[:, None] * (moves.end - moves.start)[move]
    if layered:
        tops = layer_tops(job)
        high = np.diff(tops, prepend=tops[0] - (tops[1] - tops[0] if len(tops) > 1 else 0.0))
        at[:, 2] -= 0.5 * high[np.clip(job.source, 0, len(high) - 1)][move]
    return WrittenPlaces(at, (length / count)[move], moves.line[move], moves.stroke[move])


def save_written(path: Path, places: WrittenPlaces, ink: FloatArray) -> None:
    """Keep what the scan has at each place: 1 for ink, 0 for none, NaN where it can't tell."""
    np.savez(path, length_mm=places.length_mm, line=places.line, stroke=places.stroke, ink=ink)


def looks_and_scan(
    path: Path,
    looks: Sequence[LookRecord],
    inserts: Sequence[Insert],
    last_lines: Sequence[int],
    gap_mm: float,
) -> list[dict[str, Any]]:
    """Return what each look said of its stretch of the job beside what the final scan has there.

    Parameters
    ----------
    path : Path
        Of `save_written`.
    looks : sequence of LookRecord
    inserts : sequence of Insert
        Of the print's journal: what was really done.
    last_lines : sequence of int
        Line of the G-code file up to which each look saw.
    gap_mm : float, mm
        Shorter stretches without ink are let pass.
    """
    with np.load(path) as data:
        length, line, stroke, ink = (data[k] for k in ("length_mm", "line", "stroke", "ink"))
    mended = {one.look for one in inserts if one.lines}
    rows, before = [], 0
    for k, (look, last) in enumerate(zip(looks, last_lines, strict=True)):
        if last in last_lines[k + 1 :]:  # looked at again
            continue
        own = (line > before) & (line <= last)
        before = last
        rows.append(_row(look, look.number in mended, length[own], stroke[own], ink[own], gap_mm))
    return rows


def _row(
    look: LookRecord,
    mended: bool,
    length: FloatArray,
    stroke: IntArray,
    ink: FloatArray,
    gap_mm: float,
) -> dict[str, Any]:
    way, known = float(length.sum()), np.isfinite(ink)
    known_mm = float(length[known].sum())
    missing = missing_mm(length, stroke, ink, gap_mm)
    gaps = sum(g["to_mm"] - g["from_mm"] for g in look.found.get("gaps", ()))
    left = look.found.get("left_mm", 0.0) if mended else gaps
    row = {
        "look": look.number,
        "mark": look.mark.partition(",")[0],
        "way_mm": round(way, 3),
        "judged": look.found.get("seen_share"),
        "ink": look.found.get("coverage"),
        "mended": mended,
        "gaps_mm": round(gaps, 3),
        "left_mm": round(left, 3),
        "scan_known": round(known_mm / way, 5) if way else 0.0,
        "scan_ink": round(float(length[known] @ ink[known]) / known_mm, 5) if known_mm else None,
        "scan_missing_mm": round(missing, 3),
    }
    return {**row, **_agreement(row)}


def missing_mm(length: FloatArray, stroke: IntArray, ink: FloatArray, gap_mm: float) -> float:
    """Return the length of stretches without ink along unbroken lines, each ``gap_mm`` or more."""
    free = np.append(np.where(ink == 0, stroke, -1), -1)  # NaN is neither
    begins = np.flatnonzero(free != np.append(-1, free[:-1]))
    upto = np.append(0.0, np.cumsum(length))
    ends = np.append(begins[1:], len(free) - 1)
    long = upto[np.minimum(ends, len(length))] - upto[np.minimum(begins, len(length))]
    return float(long[(free[begins] >= 0) & (long >= gap_mm)].sum())


def _agreement(row: dict[str, Any]) -> dict[str, Any]:
    """Whether look and scan agree: true, false or None where that can't be told; and in words.

    A look's own share of ink is told, its mends counted in, where it speaks against what it said.
    """
    verdict = "mended" if row["mended"] else "whole"
    missing = row["scan_missing_mm"]
    scan = "scan: missing" if missing else "scan: whole"
    if row["scan_known"] < _LEAST_SEEN:
        return {"agree": None, "words": "scan tells too little"}
    if row["judged"] is None or row["judged"] < _LEAST_SEEN:
        return {"agree": None, "words": f"look saw too little; {scan}"}
    if row["left_mm"]:
        done = "mended, " if row["mended"] else ""
        words = f"look: {done}{row['left_mm']:.2f} mm left; {scan}"
        return {"agree": bool(missing), "words": words}
    judged_mm = row["judged"] * row["way_mm"]
    if missing and missing <= row["way_mm"] - judged_mm:
        ink = 1.0 if row["ink"] is None else row["ink"] + row["gaps_mm"] / judged_mm
        own = f"; its own ink {ink:.0%}" if ink < _PLENTY else ""
        return {"agree": None, "words": f"look: {verdict}{own}; {scan}, perhaps unjudged"}
    return {"agree": not missing, "words": f"look: {verdict}; {scan}"}
