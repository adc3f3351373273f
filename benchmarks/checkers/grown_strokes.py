"""Compare a printer's strokes with those of a file and its inserts, read by a reader of its own.

A stroke is a move across (X or Y changes). A host's own moves in a pause or a look go up and down
alone, so every stroke of the motors is one of the file or of an insert, in its order, once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sim.gcode.motion.executed import ExecutedMotion

WITHIN_MM = 0.02
WITHIN_E_MM = 0.002
Stroke = tuple[float, float, float, float]
"""End x, y, z, mm, and the plunger's push on the way, mm."""


@dataclass(frozen=True)
class Compared:
    """What became of a grown file's strokes.

    Attributes
    ----------
    expected, made : int
        How many there are in the text, and by the motors.
    wrong : int
        Places in the order at which the two differ; of those beyond the shorter list, all.
    misnamed : int
        Strokes that the record calls another command than the text's.
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
    """Compare.

    Parameters
    ----------
    commands : sequence of str
        Of the grown file, one a line, without comments; absolute places throughout.
    start : (x, y, z), mm
        Where the tip stands before them.
    motion : ExecutedMotion
    """
    asked = _of_text(commands, start)
    done = [
        (line, (float(end[0]), float(end[1]), float(end[2]), float(push)))
        for begin, end, push, line in zip(
            motion.start,
            motion.end,
            motion.plunger_end - motion.plunger_start,
            motion.line.tolist(),
            strict=True,
        )
        if max(abs(end[0] - begin[0]), abs(end[1] - begin[1])) > WITHIN_MM / 4
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
