"""Data class of G-code lines inserted into a running job; count lines with and without them.

A job grows at the place where the print is held, so the lines of an insert follow those that were
taken, and no later insert moves an earlier one.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

Position: TypeAlias = tuple[int, int]
"""Command lines before an insert, in the grown job, and how many it has."""


@dataclass(frozen=True)
class Insert:
    """Lines that were put into a job in a look, and what its rest pushes from there on.

    Attributes
    ----------
    look : int
        Number of the look, from 1.
    after : int
        Command lines of the job before them, with earlier inserts.
    lines : tuple of bytes
        As they are sent.
    why : str
    flow : float
        Behind them the job's moves that write push so many times what its file says.
    again : bool
        Whether another look is made once they are written.
    """

    look: int
    after: int
    lines: tuple[bytes, ...]
    why: str = ""
    flow: float = 1.0
    again: bool = False

    @property
    def sha256(self) -> str:
        """Hash of the lines and the flow."""
        said = (*self.lines, b"flow %.4f" % self.flow)
        return hashlib.sha256(b"\n".join(said)).hexdigest()

    def to_record(self) -> dict[str, Any]:
        """As the journal has it."""
        lines = [line.decode("ascii") for line in self.lines]
        told = {"look": self.look, "after": self.after, "why": self.why, "flow": self.flow}
        again = {"again": True} if self.again else {}
        return {**told, **again, "sha256": self.sha256, "lines": lines}

    @staticmethod
    def from_record(record: Mapping[str, Any]) -> Insert:
        """Read `to_record`."""
        lines = tuple(str(line).encode("ascii") for line in record["lines"])
        return Insert(
            look=int(record["look"]),
            after=int(record["after"]),
            lines=lines,
            why=str(record.get("why", "")),
            flow=float(record.get("flow", 1.0)),
            again=bool(record.get("again", False)),
        )


def file_count(done: int, positions: Sequence[Position]) -> int:
    """Return how many of the first ``done`` lines of a grown job are the file's own commands."""
    return done - sum(min(max(done - after, 0), count) for after, count in positions)


def behind(index: int, after: int, count: int) -> int:
    """Return a place between lines of a job as it is once ``count`` lines follow its ``after``."""
    return index + count if index > after else index
