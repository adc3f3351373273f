"""Read a G-code file into the command lines to send, all checked before anything is sent.

What is sent is rendered from what was understood (`gcode.reading`): capitals, one blank between
words, without the file's line numbers, checksums and comments. A file gives the same lines each
time.

A job grows at the place where the print is held, so the lines of an insert follow those that were
taken, and no later insert moves an earlier one.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from firmware_profiles import Printer
from gcode.errors import GcodeError
from gcode.reading.file import GcodeFile, kinds_of, read_file
from gcode.reading.line import Lines
from gcode.reading.read import plunger_word, with_flow
from gcode.user_files import read_gcode_path, text_of
from printctl.checks.gate import refused_lines
from printctl.machine.errors import JobError
from printctl.machine.job.marks import Marks, Position, read_marks

_MOVES: Final = (b"G0 ", b"G1 ")
_COMMENTS: Final = (b";", b"//")
_NEVER_CUT_BYTES: Final = 16
"""Of a line that no firmware's buffer cuts, whatever its number (profile: 32 at least)."""


@dataclass(frozen=True)
class Insert:
    """Lines that were put into a job in a look, and what its rest pushes from there on.

    They stand behind the first ``after`` lines of the job, earlier inserts counted. Behind them the
    job's moves that write push ``flow`` times what its file says. ``look`` counts from 1; ``again``
    is whether another look is made once they are written.
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
        return hashlib.sha256(b"\n".join((*self.lines, b"flow %.4f" % self.flow))).hexdigest()

    def to_record(self) -> dict[str, Any]:
        """Return it as the journal has it."""
        lines = [line.decode("ascii") for line in self.lines]
        record = {"look": self.look, "after": self.after, "why": self.why, "flow": self.flow}
        again = {"again": True} if self.again else {}
        return {**record, **again, "sha256": self.sha256, "lines": lines}

    @staticmethod
    def from_record(record: Mapping[str, Any]) -> Insert:
        """Read `to_record`."""
        lines = tuple(str(line).encode("ascii") for line in record["lines"])
        why, flow = str(record.get("why", "")), float(record.get("flow", 1.0))
        again = bool(record.get("again", False))
        return Insert(int(record["look"]), int(record["after"]), lines, why, flow, again)


def file_count(done: int, positions: Sequence[Position]) -> int:
    """Return how many of the first ``done`` lines of a grown job are the file's own commands."""
    return done - sum(min(max(done - after, 0), count) for after, count in positions)


@dataclass(frozen=True)
class Job:
    """Command lines without comments and blanks, as `gcode.reading.read_line` renders them.

    Attributes
    ----------
    lines : list of bytes
    file_lines : list of int
        One-based line of the file that each came from; of an insert's, of the last one before it.
    sha256, name : str
        Hash of the whole file, and its name.
    marks : Marks
    inserts : tuple of Insert
        Lines that were put in while it was printed, in their order; they are among ``lines``.
    """

    lines: list[bytes]
    file_lines: list[int]
    sha256: str
    name: str
    marks: Marks = field(default_factory=lambda: Marks([]))
    inserts: tuple[Insert, ...] = ()

    def __len__(self) -> int:
        return len(self.lines)

    def file_line(self, done: int) -> int:
        """Return the file line of the last of ``done`` command lines; 0 for none."""
        return self.file_lines[min(done, len(self.lines)) - 1] if done > 0 and self.lines else 0

    @property
    def own(self) -> Job:
        """The file's own commands, without what was put in; its marks aren't shifted back."""
        lines, file_lines = list(self.lines), list(self.file_lines)
        for after, count in reversed(self.positions):
            del lines[after : after + count]
            del file_lines[after : after + count]
        return replace(self, lines=lines, file_lines=file_lines, inserts=())

    @property
    def positions(self) -> tuple[Position, ...]:
        """Where its inserts stand, and how many lines each has."""
        return tuple((one.after, len(one.lines)) for one in self.inserts)

    @property
    def flow(self) -> float:
        """What moves that write push behind its last insert, over what the file says."""
        return self.inserts[-1].flow if self.inserts else 1.0

    def grown_by(self, inserts: Sequence[Insert]) -> Job:
        """Return the job with several inserts, in their order; see `grown`."""
        job = self
        for insert in inserts:
            job = job.grown(insert)
        return job

    def grown(self, insert: Insert) -> Job:
        """Return the job with an insert's lines behind its first ``insert.after`` lines.

        Marks at that place stay before them. What writes behind them pushes ``insert.flow`` of what
        the file says (`gcode.reading.read`). Raises `JobError` where the job has fewer
        lines, a later insert, or no count of the plunger where its flow is to change.
        """
        after, count = insert.after, len(insert.lines)
        begun = max((one.after + len(one.lines) for one in self.inserts), default=0)
        if not begun <= after <= len(self):
            raise JobError(
                f"injected G-code behind line {after} doesn't fit {self.name}, {len(self)} lines "
                f"with injected G-code up to line {begun}; the journal isn't of this job"
            )
        line, rest = self.file_line(after), self.lines[after:]
        if insert.flow != self.flow:
            counts = map(plunger_word, reversed(self.lines[:after]))
            e_mm = next((mm for mm in counts if mm is not None), None)
            if e_mm is None:
                raise JobError(f"{self.name} doesn't set the E position after line {after}")
            rest = with_flow(rest, e_mm, insert.flow / self.flow)
        return replace(
            self,
            lines=[*self.lines[:after], *insert.lines, *rest],
            file_lines=[*self.file_lines[:after], *[line] * count, *self.file_lines[after:]],
            marks=self.marks.shifted(after, count),
            inserts=(*self.inserts, insert),
        )


def load_job(path: Path, printer: Printer) -> Job:
    """Read a G-code file for a printer, whose firmware family says how its lines are read.

    Raises `JobError`, which names the line, where the file can't be read, is empty, or has a line
    that must not be sent.
    """
    try:
        data = read_gcode_path(path)
    except OSError as exc:
        raise JobError(f"job file {path} can't be read: {exc.strerror}; check the path") from exc
    return parse_job(data, path.name, printer)


def parse_job(data: bytes, name: str, printer: Printer) -> Job:
    """Read G-code bytes; see `load_job`."""
    read = _read(data, name, printer)
    if printer.streamed:
        _check_gate(read.others, name, printer)
    lines: list[bytes] = []
    file_lines: list[int] = []
    comments: list[tuple[int, bytes]] = []
    texts = text_of(data).splitlines()
    for number, (command, raw) in enumerate(zip(read.lines, texts, strict=True), 1):
        if command:
            if len(command) > _NEVER_CUT_BYTES or not command.startswith(_MOVES):
                _check(command, f"{name}, line {number}", printer.max_line_bytes, len(lines) + 1)
            lines.append(command)
            file_lines.append(number)
        elif raw.startswith(_COMMENTS):
            text = b";" + raw.removeprefix(b"//").removeprefix(b";")
            comments.append((len(lines), text))
    if not lines:
        raise JobError(f"{name} contains no commands; nothing to print")
    marks = Marks(read_marks(comments))
    return Job(lines, file_lines, hashlib.sha256(data).hexdigest(), name, marks)


def _read(data: bytes, name: str, printer: Printer) -> GcodeFile:
    try:
        read = read_file(data, printer)
    except GcodeError as exc:
        raise JobError(f"{name}: {exc}") from exc
    if read.refused:
        kinds = [
            f"{name}, line {line}: {error}" + (f" ({count} such lines)" if count > 1 else "")
            for line, error, count in kinds_of(read.refused)
        ]
        raise JobError("\n".join(kinds))
    return read


def _check(command: bytes, where: str, max_line_bytes: int, number: int) -> None:
    sent = len(command) + len(b"N%d *255\n" % number)
    if sent > max_line_bytes:
        raise JobError(
            f"{where}: {sent} bytes with number and checksum exceed {max_line_bytes} (profile: "
            "max_line_bytes), the firmware would truncate it; shorten the line"
        )


def _check_gate(others: Lines, name: str, printer: Printer) -> None:
    """Refuse a job with commands that the gate refuses; each code once, by its first line."""
    first: dict[str, str] = {}
    for number, code, why in refused_lines(others, printer):
        remedy = "" if "; remove it" in why else "; remove it"
        first.setdefault(code, f"{name}, line {number}: {why}{remedy}")
    if first:
        raise JobError("\n".join(first.values()))


@dataclass(frozen=True)
class GrownText:
    """A job as text.

    ``lines`` are rows with their line ends: the file's, and each insert's before the file's command
    that follows it. ``row_of`` is the row, from 0, of each command line of the job; ``file_row``
    the row of the file that each row is, -1 for what was put in.
    """

    lines: list[bytes]
    row_of: list[int]
    file_row: list[int]


def grown_text(job: Job, data: bytes) -> GrownText:
    """Put a job's inserts into the text of its file, ``data``."""
    own = data.splitlines(keepends=True)
    inserted = {k for after, count in job.positions for k in range(after, after + count)}
    before_row, row = dict[int, list[int]](), len(own)
    for index in range(len(job) - 1, -1, -1) if inserted else ():
        if index in inserted:
            before_row.setdefault(row, []).append(index)
        else:
            row = job.file_lines[index] - 1
    lines, file_row, row_of_file = list[bytes](), list[int](), list[int]()
    first_of: dict[int, int] = {}
    for row in range(len(own) + 1):
        for index in reversed(before_row.get(row, ())):
            first_of[index] = len(lines)
            if lines and not lines[-1].endswith((b"\n", b"\r")):
                lines[-1] += b"\n"
            lines.append(job.lines[index] + b"\n")
            file_row.append(-1)
        if row < len(own):
            row_of_file.append(len(lines))
            lines.append(own[row])
            file_row.append(row)
    row_of = [
        first_of[index] if index in first_of else row_of_file[line - 1]
        for index, line in enumerate(job.file_lines)
    ]
    flows = [one.after for one in job.inserts if one.flow != 1.0]
    for index in range(min(flows, default=len(job)), len(job)):
        if index not in inserted:  # its dose may be another than the file's
            lines[row_of[index]] = with_comment(job.lines[index], lines[row_of[index]])
    return GrownText(lines, row_of, file_row)


def with_comment(line: bytes, row: bytes) -> bytes:
    """Return a command line as a row of text, with the comment of the row that it was."""
    _, semicolon, comment = row.rstrip(b"\r\n").partition(b";")
    return line + semicolon + comment + b"\n"
