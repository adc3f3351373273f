"""Compare a printer's strokes with those of a file and its inserts, read by a reader of its own.

A stroke is a move across (X or Y changes). A host's own moves in a pause or a look go up and down
alone, so every stroke of the motors is one of the file or of an insert, in its order, once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcode.motion.executed import ExecutedMotion

WITHIN_MM = 0.02
WITHIN_E_MM = 0.002
Stroke = tuple[float, float, float, float]
"""End x, y, z, mm, and the plunger's push on the way, mm."""


@dataclass(frozen=True)
class Compared:
    """What became of a grown file's strokes, as many as ``expected`` in the text.

    ``wrong``: places in the order at which text and motors differ, all beyond the shorter list;
    ``misnamed``: strokes that the record calls another command than the text's.
    """

    expected: int
    made: int
    wrong: int
    misnamed: int

    @property
    def exact(self) -> bool:
        """Whether each stroke was made once, in order, by its own command."""
        return self.expected == self.made and self.wrong == self.misnamed == 0


def compared(
    commands: Sequence[str], start: tuple[float, float, float], motion: ExecutedMotion
) -> Compared:
    """Compare commands of a grown file, absolute and without comments, with executed motion.

    ``start`` is where the tip stands before them, mm.
    """
    asked = _of_text(commands, start)
    across = np.abs(motion.end - motion.start)[:, :2].max(axis=1) > WITHIN_MM / 4
    made = np.column_stack([motion.end, motion.plunger_end - motion.plunger_start])[across]
    done: list[tuple[int, Stroke]] = [
        (line, (x, y, z, push))
        for line, (x, y, z, push) in zip(motion.line[across].tolist(), made.tolist(), strict=True)
    ]
    pairs = list(zip(asked, done, strict=False))
    wrong = sum(not _same(one, other) for (_, one), (_, other) in pairs)
    misnamed = sum(line != named for (line, _), (named, _) in pairs)
    beyond = abs(len(asked) - len(done))
    return Compared(len(asked), len(done), wrong + beyond, misnamed)


def _of_text(
    commands: Sequence[str], start: tuple[float, float, float]
) -> list[tuple[int, Stroke]]:
    at = {"X": start[0], "Y": start[1], "Z": start[2], "E": 0.0}
    found = []
    for number, command in enumerate(commands):
        code, *words = command.split()
        if code not in ("G0", "G1", "G92"):
            continue
        to = at | {word[0]: float(word[1:]) for word in words if word[0] in at}
        if code != "G92" and (to["X"], to["Y"]) != (at["X"], at["Y"]):
            found.append((number, (to["X"], to["Y"], to["Z"], to["E"] - at["E"])))
        at = to
    return found


def _same(one: Stroke, other: Stroke) -> bool:
    place = all(abs(a - b) <= WITHIN_MM for a, b in zip(one[:3], other[:3], strict=True))
    return place and abs(one[3] - other[3]) <= WITHIN_E_MM
