"""Pack a G-code job into compressed chunks that a page unpacks on demand.

A piece holds the moves of one or more layers. Its places are whole µm as differences from move to
move; 32-bit numbers are laid out byte by byte (all lowest bytes first), which deflates to half. A
move begins where the one before it ended; where it doesn't, a row of `Act.JUMP` says where.
"""

from __future__ import annotations

import base64
import zlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray
from registration.gcode_job import Act, GcodeJob

MOVES_A_CHUNK: Final = 30_000
"""Moves from which on a new piece begins with the next layer."""
NO_WIDTH: Final = 65_535
_UM: Final = 1e-3


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
    place = np.rint(np.where(jumps[:, None], job.start[move], job.end[move]) / _UM).astype(np.int64)
    act = np.where(jumps, np.uint8(Act.JUMP), job.act[move])
    dosed = np.isin(act, (Act.PRIME, Act.RETRACT, Act.WIPE))
    line = job.line[move]
    fields = [
        *(planes(np.diff(place[:, axis], prepend=0)) for axis in range(3)),
        planes(np.rint(job.speed_mm_s[move] / _UM)),
        planes(np.diff(line, prepend=0)),
        planes(np.full(len(move), -1) if job.vessel is None else job.vessel[move]),
        _widths(np.where(jumps, np.nan, job.width_mm[move])),
        act.astype(np.uint8).tobytes(),
        (job.kind[move] + 1).astype(np.uint8).tobytes(),
        job.dose_ul[move][dosed].astype("<f4").tobytes(),
    ]
    return Chunk(len(move), encoded(b"".join(fields)), encoded(_text(lines, line)))


def planes(values: NDArray[Any]) -> bytes:
    """Whole numbers as int32, all lowest bytes first."""
    whole = np.asarray(np.clip(values, -(2**31), 2**31 - 1)).astype("<i4")
    return np.ascontiguousarray(whole.view(np.uint8).reshape(-1, 4).T).tobytes()


def _widths(width_mm: FloatArray) -> bytes:
    """Widths in whole µm, `NO_WIDTH` where there is none; low bytes first, then high ones."""
    um = np.clip(np.rint(width_mm / _UM), 0, NO_WIDTH - 1)
    whole = np.where(np.isnan(um), NO_WIDTH, um).astype("<u2")
    return np.ascontiguousarray(whole.view(np.uint8).reshape(-1, 2).T).tobytes()


def _text(lines: list[bytes] | None, line: IntArray) -> bytes:
    if lines is None:
        return b""
    new = np.diff(line, prepend=-1) != 0
    shown = zip(line.tolist(), new.tolist(), strict=True)
    return b"\n".join([lines[number - 1] if own else b"" for number, own in shown])


def encoded(data: bytes) -> str:
    """Deflated, in base64."""
    return base64.b64encode(zlib.compress(data, 6)).decode("ascii") if data else ""
