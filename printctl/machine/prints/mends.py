"""Strokes and ink of lines that were inserted into a print."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from gcode.reading import code_of, read_sent
from printctl.machine.job.coordinates import AXES, modal_state
from printctl.machine.job.job import Insert, Job
from printctl.machine.job.syringes import plunger_travel

Place = tuple[float, float, float]


def pushed_mm(inserts: Sequence[Insert], executed: int) -> float:
    """Return how far inserts before ``executed`` lines of the grown job pushed the plunger, mm.

    An insert ends by counting the plunger as before it (G92 E), so that this is where it begins.
    """
    travel = 0.0
    for insert in inserts:
        before = [line for line in insert.lines if line.startswith(b"G92 E")][-1:]
        if before and insert.after < executed:
            travel += plunger_travel([*before, *insert.lines])[-1]
    return travel


@dataclass(frozen=True)
class MendStrokes:
    """What one insert writes, for the live view.

    Attributes
    ----------
    look : int
        After which it was put in.
    last : int
        Command lines of the grown job up to its end.
    strokes : tuple of tuple of (x, y, z), mm
        Corners of each unbroken line.
    """

    look: int
    last: int
    strokes: tuple[tuple[Place, ...], ...]

    def to_dict(self, executed: int) -> dict[str, Any]:
        """As a JSON object, with whether it is among the ``executed`` lines of the grown job."""
        lines = [[list(place) for place in stroke] for stroke in self.strokes]
        return {"look": self.look, "written": self.last <= executed, "strokes": lines}


def mend_strokes(job: Job) -> list[MendStrokes]:
    """Return what the inserts of a grown job (absolute coordinates) write.

    Those that only correct the flow write none.
    """
    mends = (MendStrokes(one.look, one.after + len(one.lines), _strokes(job, one))
             for one in job.inserts)  # fmt: skip
    return [one for one in mends if one.strokes]


def _strokes(job: Job, insert: Insert) -> tuple[tuple[Place, ...], ...]:
    """Ways across on which the plunger goes forward; those that follow each other are one line."""
    at: dict[str, float] = {
        axis.upper(): mm for axis, mm in modal_state(job.lines, insert.after).place().items()
    }
    strokes: list[list[Place]] = []
    joined = False
    for line in insert.lines:
        code = code_of(line)
        if code not in (b"G0", b"G1", b"G92"):
            continue
        before = dict(at)
        at |= {a: v for a, v in read_sent(line).words.items() if a in AXES and v is not None}
        if code == b"G92" or any(axis not in before for axis in AXES):
            joined = False
            continue
        writes = at["E"] > before["E"] and (at["X"], at["Y"]) != (before["X"], before["Y"])
        if writes and not joined:
            strokes.append([_place(before)])
        if writes:
            strokes[-1].append(_place(at))
        joined = writes
    return tuple(map(tuple, strokes))


def _place(at: dict[str, float]) -> Place:
    return at["X"], at["Y"], at["Z"]
