"""Pack a G-code job into compressed chunks that a page unpacks on demand.

A piece holds the moves of one or more layers as `COLUMNS`. A move begins where the one before it
ended; where it doesn't, a row of `Act.JUMP` says where.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import IntArray
from registration.gcode_job import Act, GcodeJob
from report.packing import PackedColumn, deflated, pack_columns

MOVES_A_CHUNK: Final = 30_000
"""Moves from which on a new piece begins with the next layer."""
_UM: Final = 1e-3
NO_WIDTH: Final = 65_535
PLACE_COLUMNS: Final = tuple(PackedColumn(axis, "i4", _UM, summed=True) for axis in "xyz")
COLUMNS: Final = (
    *PLACE_COLUMNS,
    PackedColumn("speed", "i4", _UM),
    PackedColumn("line", "i4", summed=True),
    PackedColumn("vessel", "i4"),
    PackedColumn("width", "u2", _UM, none=NO_WIDTH),
    PackedColumn("act", "u1"),
    PackedColumn("kind", "i2"),
    PackedColumn("dose", "f4"),
)
"""Of a row: places and widths in mm, speed in mm/s, dose in µL."""


@dataclass(frozen=True, eq=False)
class Chunk:
    """One piece.

    Attributes
    ----------
    rows : int
        Rows in it, jumps included.
    data, text : str
        Its numbers, and the file's line of each row ("" where it is of the same line as the row
        before); deflated and in base64.
    """

    rows: int
    data: str
    text: str


@dataclass(frozen=True, eq=False)
class PackedPieces:
    """All pieces and where each layer lies in them, (k,) each.

    Attributes
    ----------
    chunks : list of Chunk
    chunk : (k,) int64
    first, last : (k,) int64
        Rows of the chunk: ``first`` to ``last``, the latter not among them.
    """

    chunks: list[Chunk]
    chunk: IntArray
    first: IntArray
    last: IntArray


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows of the page; ``move`` is the job's, for a jump the one that it leads to."""

    move: IntArray
    jumps: NDArray[np.bool_]
    layer: IntArray
    chunk: IntArray


def pack_job(job: GcodeJob, with_text: bool) -> PackedPieces:
    """Pack all moves; ``with_text`` the file's lines, too."""
    rows = _in_layers(job)
    bounds = np.searchsorted(rows.chunk, np.arange(int(rows.chunk[-1]) + 2))
    lines = job.text.split(b"\n") if with_text else None
    # Deflating lets other threads run; the pieces don't depend on how many there are.
    with ThreadPoolExecutor() as pool:
        parts = [slice(a, b) for a, b in pairwise(bounds.tolist())]
        chunks = list(pool.map(lambda part: _chunk(job, rows, part, lines), parts))
    numbers = np.arange(len(job.layers))
    first = np.searchsorted(rows.layer, numbers)
    last = np.searchsorted(rows.layer, numbers, side="right")
    chunk = rows.chunk[np.minimum(first, len(rows.chunk) - 1)]
    return PackedPieces(chunks, chunk, first - bounds[chunk], last - bounds[chunk])


def _in_layers(job: GcodeJob) -> _Rows:
    """Moves layer after layer, in each in the file's order, with jumps where they don't join."""
    order = np.argsort(job.layer, kind="stable")
    layer = job.layer[order]
    count = np.bincount(layer, minlength=len(job.layers))
    chunk_of_layer = _group(count)
    chunk = chunk_of_layer[layer]
    begins = np.concatenate([[True], np.diff(chunk) != 0])
    apart = np.concatenate([[True], (job.start[order[1:]] != job.end[order[:-1]]).any(axis=1)])
    at = np.flatnonzero(begins | apart)
    jumps = np.insert(np.zeros(len(order), bool), at, True)
    return _Rows(
        np.insert(order, at, order[at]),
        jumps,
        np.insert(layer, at, layer[at]),
        np.insert(chunk, at, chunk[at]),
    )


def _group(count: IntArray) -> IntArray:
    """Number of the chunk of each layer, so that each but the last has `MOVES_A_CHUNK` or more."""
    chunk, held, number = np.zeros(len(count), np.int64), 0, 0
    for layer, moves in enumerate(count.tolist()):
        if held >= MOVES_A_CHUNK:
            number, held = number + 1, 0
        chunk[layer] = number
        held += moves
    return chunk


def _chunk(job: GcodeJob, rows: _Rows, part: slice, lines: list[bytes] | None) -> Chunk:
    move, jumps = rows.move[part], rows.jumps[part]
    place = np.where(jumps[:, None], job.start[move], job.end[move])
    act = np.where(jumps, np.uint8(Act.JUMP), job.act[move])
    dosed = np.isin(act, (Act.PRIME, Act.RETRACT, Act.WIPE))
    line = job.line[move]
    values = {
        "x": place[:, 0],
        "y": place[:, 1],
        "z": place[:, 2],
        "speed": job.speed_mm_s[move],
        "line": line,
        "vessel": np.full(len(move), -1) if job.vessel is None else job.vessel[move],
        "width": np.where(jumps, np.nan, job.width_mm[move]),
        "act": act,
        "kind": job.kind[move],
        "dose": np.where(dosed, job.dose_ul[move], 0.0),
    }
    text = _text(lines, line)
    return Chunk(len(move), pack_columns(COLUMNS, values), deflated(text) if text else "")


def _text(lines: list[bytes] | None, line: IntArray) -> bytes:
    if lines is None:
        return b""
    new = np.diff(line, prepend=-1) != 0
    shown = zip(line.tolist(), new.tolist(), strict=True)
    return b"\n".join([lines[number - 1] if own else b"" for number, own in shown])
