"""The job: the file's command lines as they are sent, checked before the first byte."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass, field
from pathlib import Path

from printctl.link.errors import JobError
from printctl.link.marks import MarkReader, Marks

# What the link itself must be alone to send, or what would break "a repeated line doses nothing".
_REFUSED = {
    b"M83": "relative extrusion: a line sent again would dose twice; write M82 and absolute E",
    b"G91": "relative moves: a line sent again would move twice; write G90 and absolute X Y Z",
    b"G20": "inches: the link's own moves are in mm; write the job in mm",
    b"M110": "it renumbers the lines, which the link does itself; take it out",
    b"M112": "it would halt the printer; take it out and use `printctl` to stop",
    b"M999": "it clears an error state that the user must see; take it out",
    b"M0": "it waits for a button on the printer for ever; take it out and pause from the host",
    b"M1": "it waits for a button on the printer for ever; take it out and pause from the host",
    b"M108": "it breaks the printer's waits; take it out",
    b"M410": "it loses the position; take it out",
}
_CODE = re.compile(rb"([GMT])0*(\d+)")
_PARENTHESES = re.compile(rb"\([^)]*\)")


@dataclass(frozen=True)
class Job:
    """Command lines without comments and blanks.

    Attributes
    ----------
    lines : list of bytes
        One command each, without line end, number or checksum.
    file_lines : list of int
        One-based line of the file that each came from.
    sha256 : str
        Hash of the whole file.
    name : str
        The file's name.
    marks : Marks
        Where layers and vessels end and the syringe may be changed, from the file's comments.
    """

    lines: list[bytes]
    file_lines: list[int]
    sha256: str
    name: str
    marks: Marks = field(default_factory=lambda: Marks([]))

    def __len__(self) -> int:
        return len(self.lines)

    def file_line(self, done: int) -> int:
        """File line of the last of ``done`` command lines; 0 for none."""
        return self.file_lines[min(done, len(self.lines)) - 1] if done > 0 and self.lines else 0


def load_job(path: Path, max_line_bytes: int) -> Job:
    """Read a G-code file.

    Parameters
    ----------
    path : Path
    max_line_bytes : int
        The firmware's longest line, number and checksum included (profile).

    Raises
    ------
    JobError
        When the file can't be read, is empty, or has a line that must not be sent; the message
        names the line.
    """
    try:
        data = path.read_bytes()
    except OSError as exc:
        raise JobError(f"job file {path} can't be read: {exc.strerror}; check the path") from exc
    return parse_job(data, path.name, max_line_bytes)


def parse_job(data: bytes, name: str, max_line_bytes: int = 96) -> Job:
    """Read G-code bytes; see `load_job`."""
    lines: list[bytes] = []
    file_lines: list[int] = []
    marks = MarkReader()
    for number, raw in enumerate(data.splitlines(), start=1):
        command = command_of(raw)
        if raw[:2] == b"//":
            raw = b";" + raw[2:]
        if raw[:1] == b";":
            marks.comment(raw, len(lines))
        elif command:
            _check(command, f"{name}, line {number}", max_line_bytes, len(lines) + 1)
            lines.append(command)
            file_lines.append(number)
    if not lines:
        raise JobError(f"{name} has no command in it; nothing to print")
    return Job(lines, file_lines, hashlib.sha256(data).hexdigest(), name, Marks(marks.found))


def command_of(raw: bytes) -> bytes:
    """What is sent of a line; empty where it is a comment or blank."""
    if raw[:2] == b"//":  # how a comment begins in an Aerotech's file
        return b""
    command = raw.split(b";", 1)[0]
    if b"(" in command:
        command = _PARENTHESES.sub(b"", command)
    return command.strip()


def _check(command: bytes, where: str, max_line_bytes: int, number: int) -> None:
    sent = len(command) + len(b"N%d *255\n" % number)
    if sent > max_line_bytes:
        raise JobError(
            f"{where}: {sent} bytes with number and checksum exceed {max_line_bytes} "
            "(profile: max_line_bytes), the firmware would cut it; shorten the line"
        )
    if not command.isascii() or not command.decode("ascii").isprintable() or b"*" in command:
        raise JobError(f"{where}: {command!r} has a character that can't be sent; remove it")
    code = _CODE.match(command)
    word = code.group(1) + code.group(2) if code else b""
    if word in _REFUSED:
        raise JobError(f"{where}: {word.decode()}: {_REFUSED[word]}")
