"""Find where a print may pause (layer or pass end, reload point); put comments there in G-code.

========== ====================================================================================
mark       after the lines above it
========== ====================================================================================
LAYER_END  layer n is written; where another follows the needle stands at its height or above
PASS_END   a pass that ended along vessel n is written, the way straight up is free
PART_END   part of a pass is written, up to within vessel n; what follows would bar a mend of it
HEIGHT     before layer n, where layers differ: its height, mm (the sign that other slicers use)
RELOAD     the plunger is relieved and the way straight up is free: the syringe may be changed
========== ====================================================================================

A mark is a line of its own, ``;LAYER_END:3`` (``//LAYER_END:3`` where that begins a comment); a
firmware never sees it. In a FRESH print the tip
is always at the top of what is written; in an embedded one a pass ends above what stands around it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from design.toolpath.gcode.job import Gcode
from design.toolpath.gcode.table import Table
from design.toolpath.toolpath import MoveKind, Toolpath
from kernels.arrays import IntArray


@dataclass(frozen=True)
class Marks:
    """Interruption marks of a job."""

    row: IntArray  # (m,), rows of the table before which each stands, ascending
    text: list[str]  # lines, without their ends

    def put_into(self, lines: bytes) -> bytes:
        """The table's rendered text with the marks in their places."""
        ends = np.flatnonzero(np.frombuffer(lines, np.uint8) == ord("\n")) + 1
        places = np.append(0, ends)[self.row]
        parts, at = [], 0
        for place, text in zip(places.tolist(), self.text, strict=True):
            parts += [lines[at:place], text.encode(), b"\n"]
            at = place
        return b"".join([*parts, lines[at:]])


def in_order(*groups: Marks) -> Marks:
    """Return all lines by their rows; at one row those of the earlier groups come first."""
    row = np.concatenate([one.row for one in groups])
    order = np.argsort(row, kind="stable")
    texts = [text for one in groups for text in one.text]
    return Marks(row[order], [texts[k] for k in order.tolist()])


def marks_of(
    toolpath: Toolpath, table: Table, before: int | None, *, last: bool, comment: str
) -> Marks:
    """Find where the needle stands free between two layers or passes.

    Parameters
    ----------
    toolpath : Toolpath
    table : Table
        Its commands.
    before : int or None
        Layer or vessel written last before this part of a job; None where nothing was.
    last : bool
        Whether the job ends with this part.
    comment : str
        How a comment begins.
    """
    marks = [*_heights(toolpath), *_ends(toolpath, before, last=last), *_named(toolpath)]
    marks.sort(key=lambda mark: mark[0])
    body = np.flatnonzero(table.move >= 0)
    moves = np.array([move for move, _ in marks], dtype=np.int64)
    rows_before = np.searchsorted(table.move[body], moves, side="right")
    first = body[0] if len(body) and before is None else 0
    row = np.where(rows_before > 0, body[np.maximum(rows_before - 1, 0)] + 1, first)
    return Marks(row, [comment + text for _, text in marks])


def _heights(toolpath: Toolpath) -> list[tuple[int, str]]:
    """Heights of layers that differ: the move before each layer's first, and the text."""
    marks = []
    for layer, height in toolpath.heights_mm.items():
        rows = np.flatnonzero(toolpath.source == layer)
        if len(rows):
            marks.append((int(rows[0]) - 1, f"HEIGHT:{height:.6g}"))
    return marks


def _ends(toolpath: Toolpath, before: int | None, *, last: bool) -> list[tuple[int, str]]:
    """Ends of layers or passes: the last move before each, and its text."""
    writes = np.flatnonzero(toolpath.kind == MoveKind.WRITE)
    if not len(writes):  # a calibration may write nothing
        return []
    source = toolpath.source[writes]
    if before is not None:
        writes, source = np.append(-1, writes), np.append(before, source)
    layers = toolpath.source_kind == "layer"
    if layers:
        breaks = (np.diff(writes) > 1) & (np.diff(source) != 0)
    else:  # where the tip leaves the ink; the plunger alone may move within a pass
        travels = np.append(0, np.cumsum(toolpath.kind == MoveKind.TRAVEL))
        breaks = np.diff(travels[writes + 1]) > 0
    name = "LAYER_END" if layers else "PASS_END"
    marks: list[tuple[int, str]] = []
    for at in np.flatnonzero(breaks & (source[:-1] >= 0)).tolist():  # a prime line is neither
        free, relieved = _lifted(toolpath, int(writes[at]), int(writes[at + 1]))
        marks.append((free, f"{name}:{source[at]}"))
        if relieved:
            marks.append((free, "RELOAD"))
    if last:
        marks.append((int(writes[-1]), f"{name}:{source[-1]}"))
    return marks


def _lifted(toolpath: Toolpath, last: int, after: int) -> tuple[int, bool]:
    """Last of the moves after ``last`` that relieve or go straight up; whether both were done."""
    relieved = raised = False
    for move in range(last + 1, after):
        way = toolpath.end[move] - toolpath.start[move]
        if toolpath.kind[move] == MoveKind.RETRACT:
            relieved = True
        elif toolpath.kind[move] == MoveKind.TRAVEL and way[2] > 0 and not way[:2].any():
            raised = True
        elif toolpath.source_kind == "layer" and not (relieved or raised or way[2]):
            continue  # a way off the lumen's wall, before the plunger is relieved
        else:
            return move - 1, relieved and raised
    return after - 1, relieved and raised


def _named(toolpath: Toolpath) -> list[tuple[int, str]]:
    """Reload points, and places to look within a pass, that the toolpath names itself."""
    reloads = np.flatnonzero(toolpath.kind == MoveKind.RELOAD)
    looks = np.flatnonzero(toolpath.kind == MoveKind.LOOK)
    parts = [(int(move), f"PART_END:{toolpath.source[move]}") for move in looks]
    return [*((int(move), "RELOAD") for move in reloads), *parts]


_PLAIN: Final = str.maketrans({";": ",", "\n": " ", "µ": "u", "°": " deg "})
"""What would end a comment, or is no ASCII."""


def add_labels(gcode: Gcode, labels: Mapping[int, str], comment: str = ";") -> Gcode:
    r"""The same lines with a comment before the first line of each move that has a label.

    Parameters
    ----------
    gcode : Gcode
    labels : mapping of int to str
        Move, as in `Gcode.line_move`, to a text of one line without the comment's sign in it. One
        beyond the last move comes after the last line of a move.
    comment : str
        How a comment begins in the firmware's files.
    """
    moves = np.flatnonzero(gcode.line_move >= 0)
    ends = np.flatnonzero(np.frombuffer(gcode.data, np.uint8) == ord("\n")) + 1
    places = np.append(0, ends)
    rows, parts, at = [], [], 0
    for move, text in sorted(labels.items()):
        later = moves[gcode.line_move[moves] >= move]
        row = int(later[0]) if len(later) else int(moves[-1]) + 1 if len(moves) else 0
        clean = text.translate(_PLAIN).replace("//", "/")
        parts += [gcode.data[at : places[row]], f"{comment}{clean}\n".encode("ascii", "replace")]
        at = int(places[row])
        rows.append(row)
    return replace(
        gcode,
        data=b"".join([*parts, gcode.data[at:]]),
        line_source=np.insert(gcode.line_source, rows, -1),
        line_move=np.insert(gcode.line_move, rows, -1),
        line_kind=np.insert(gcode.line_kind, rows, -1),
    )
