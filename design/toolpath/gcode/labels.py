"""Insert a comment into G-code before the first line of each labelled move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from design.toolpath.gcode.job import Gcode

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
