"""Merge inserted lines into a job's G-code text; map each command to its row."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from printctl.machine.job.job import Job

INSERTED: Final = -1


@dataclass(frozen=True)
class GrownText:
    """A job as text.

    Attributes
    ----------
    lines : list of bytes
        Rows with their line ends: the file's, and each insert's before the file's command that
        follows it.
    row_of : list of int
        Row, from 0, of each command line of the job.
    file_row : list of int
        Row of the file that each row is; -1 for what was put in.
    """

    lines: list[bytes]
    row_of: list[int]
    file_row: list[int]


def grown_text(job: Job, data: bytes) -> GrownText:
    """Put a job's inserts into its file's text.

    Parameters
    ----------
    job : Job
    data : bytes
        The file.
    """
    own = data.splitlines(keepends=True)
    inserts = _by_row(job, len(own))
    lines, file_row, row_of_file = list[bytes](), list[int](), list[int]()
    first_of: dict[int, int] = {}
    for row in range(len(own) + 1):
        for index in inserts.get(row, ()):
            first_of[index] = len(lines)
            if lines and not lines[-1].endswith((b"\n", b"\r")):
                lines[-1] += b"\n"
            lines.append(job.lines[index] + b"\n")
            file_row.append(INSERTED)
        if row < len(own):
            row_of_file.append(len(lines))
            lines.append(own[row])
            file_row.append(row)
    flows = [one.after for one in job.inserts if one.flow != 1.0]
    for index in range(min(flows, default=len(job)), len(job)):
        if index not in first_of:  # its dose may be another than the file's
            row = row_of_file[job.file_lines[index] - 1]
            _, semicolon, comment = lines[row].rstrip(b"\r\n").partition(b";")
            lines[row] = job.lines[index] + semicolon + comment + b"\n"
    row_of = [
        first_of[index] if index in first_of else row_of_file[line - 1]
        for index, line in enumerate(job.file_lines)
    ]
    return GrownText(lines, row_of, file_row)


def _by_row(job: Job, rows: int) -> Mapping[int, list[int]]:
    """Command lines that were put in, by the file's row before which they stand."""
    inside = [k for after, count in job.positions for k in range(after, after + count)]
    put_in, known = dict[int, list[int]](), set(inside)
    for index in inside:
        behind = index
        while behind in known:
            behind += 1
        row = job.file_lines[behind] - 1 if behind < len(job) else rows
        put_in.setdefault(row, []).append(index)
    return put_in
