"""Read the plunger push of lines inserted into a print; subtract it from the syringe's ink."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from printctl.machine.job.job import Insert, file_count
from printctl.machine.job.syringes import plunger_travel
from printctl.machine.prints.progress import Filling


@dataclass(frozen=True)
class InsertedInk:
    """Push of one insert.

    Attributes
    ----------
    after, count : int
        Lines of the grown job before it, and its own.
    pushed_mm : float, mm
        How far the plunger stands beyond where it stood before.
    """

    after: int
    count: int
    pushed_mm: float


def inserted_ink(record: Mapping[str, Any]) -> InsertedInk:
    """Read it from an insert's record of the journal.

    It ends by counting the plunger as before it (G92 E), so that this is where it begins.
    """
    insert = Insert.from_record(record)
    last = [line for line in insert.lines if line.startswith(b"G92 E")][-1:]
    pushed = plunger_travel([*last, *insert.lines])[-1] if last else 0.0
    return InsertedInk(insert.after, len(insert.lines), pushed)


def filling_in_file(filling: Filling, inserts: Sequence[InsertedInk], executed: int) -> Filling:
    """Return a syringe with what inserts took from it, its place counted in the file's commands.

    Parameters
    ----------
    filling : Filling
        Its ``command`` counted in the grown job.
    inserts : sequence of InsertedInk
    executed : int
        Lines of the grown job.
    """
    took = sum(one.pushed_mm for one in inserts if filling.command <= one.after < executed)
    command = file_count(filling.command, [(one.after, one.count) for one in inserts])
    left = filling.left_mm
    return replace(filling, command=command, left_mm=None if left is None else left - took)
