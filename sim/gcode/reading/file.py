"""Read a G-code file; collect each line's interpretation and errors."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

from firmware_profiles import Printer
from firmware_profiles.families import family_of
from sim.errors import LineError
from sim.gcode.reading.line import (
    LIMITS,
    GcodeLine,
    NamedCommand,
    plain_command,
    refusal,
    translator_of,
)
from sim.gcode.reading.read import PLAIN_MOVE, is_name, read_line, read_words
from sim.user_files import text_of

_REMEMBERED: Final = 10_000
LineReader = Callable[[bytes, Printer], GcodeLine]


@dataclass(frozen=True)
class GcodeFile:
    """A file as it was understood.

    Attributes
    ----------
    lines : list of bytes
        One for each line of the file, as it is sent; empty for a comment, an empty line, and a
        line that is refused.
    refused : tuple of (int, LineError)
        Line, from 1, and what is wrong with it.
    named : tuple of NamedCommand
        Commands with names.
    per_second : tuple of (int, bool) or None
        Lines from which on F counts per second, or per minute, and it is per second before; None
        where it is per minute throughout.
    """

    lines: list[bytes]
    refused: tuple[tuple[int, LineError], ...]
    named: tuple[NamedCommand, ...]
    per_second: tuple[tuple[int, bool], ...] | None = None

    @property
    def in_g_code(self) -> bytes:
        """The file with named commands put into the words of G-code, as many lines."""
        if not self.named:
            return b"\n".join(self.lines)
        lines = list(self.lines)
        for named in self.named:
            lines[named.line - 1] = plain_command(named)
        return b"\n".join(lines)


def read_file(
    gcode: bytes, printer: Printer, *, max_refused: int = LIMITS.max_refused, head: int = 0
) -> GcodeFile:
    """Read a whole file; each line is what `read_line` makes of it.

    The rest behind the last of ``max_refused`` refused lines isn't read. Where each head has a
    vertical axis of its own, Z is that of ``head``.

    Raises
    ------
    GcodeError
        When the bytes hold a NUL, as no text does.
    """
    gcode = text_of(gcode)
    translate = translator_of(printer)
    if translate is not None:
        written = translate(gcode, printer, head)
        read = _read_lines(written.gcode, printer, read_words, max_refused)
        return replace(read, named=written.named, per_second=written.per_second)
    return _read_lines(gcode, printer, read_line, max_refused)


def _read_lines(gcode: bytes, printer: Printer, reader: LineReader, max_refused: int) -> GcodeFile:
    lines = gcode.splitlines()
    is_plain = PLAIN_MOVE.fullmatch
    others = [index for index, text in enumerate(lines) if not is_plain(text)]
    by_name = family_of(printer).grammar.named
    refused: list[tuple[int, LineError]] = []
    named: list[NamedCommand] = []
    seen: dict[bytes, GcodeLine | LineError] = {}
    for index in others:
        text = lines[index]
        lines[index] = command = text.partition(b";")[0].rstrip(b" \t")
        if not command or is_plain(command):
            continue
        read = seen.get(text)
        if read is None:
            read = _read(text, printer, reader)
            if len(seen) < _REMEMBERED:
                seen[text] = read
        if isinstance(read, LineError):
            refused.append((index + 1, read))
            lines[index] = b""
            if len(refused) == max_refused:
                refused.append((index + 1, _gives_up(text, len(refused), len(lines))))
                del lines[index + 1 :]
                break
        else:
            lines[index] = read.text
            if by_name and is_name(read.code):
                named.append(NamedCommand(index + 1, read.code, dict(read.parameters)))
    return GcodeFile(lines, tuple(refused), tuple(named))


def _gives_up(text: bytes, refused: int, lines: int) -> LineError:
    return refusal(
        "too_many", text, f"{refused} lines up to here are refused, and the rest of the "
        f"file's {lines} wasn't read; mend them first, or give another file"
    )  # fmt: skip


def _read(text: bytes, printer: Printer, reader: LineReader) -> GcodeLine | LineError:
    try:
        return reader(text, printer)
    except LineError as error:
        return error


def kinds_of(refused: tuple[tuple[int, LineError], ...]) -> Iterator[tuple[int, LineError, int]]:
    """First line of each sort of fault, its error, and how many lines have it."""
    first: dict[str, tuple[int, LineError]] = {}
    count: dict[str, int] = {}
    for line, error in refused:
        first.setdefault(error.sort, (line, error))
        count[error.sort] = count.get(error.sort, 0) + 1
    for sort, (line, error) in first.items():
        yield line, error, count[sort]


# Read a G-code file's lines other than straight moves, with their line numbers.

Others = tuple[tuple[int, GcodeLine], ...]
"""Line of the file, from 1, and what stands there."""
_MOVES: Final = frozenset({"G0", "G1"})


def other_lines(gcode: bytes, printer: Printer) -> Others:
    """Read a file's lines that aren't moves; those that can't be read are left out.

    After so many of these as `read_file` bears (`LIMITS.max_refused`) the rest is left out, too.

    Parameters
    ----------
    printer : Printer
        Its ``firmware`` says how lines are read.
    """
    is_plain = PLAIN_MOVE.fullmatch
    others: list[tuple[int, GcodeLine]] = []
    kept: dict[bytes, GcodeLine | None] = {}
    refused = 0
    for number, text in enumerate(text_of(gcode).splitlines(), 1):
        if is_plain(text) or text[:1] == b";":
            continue
        if text not in kept:
            kept[text] = _read_line(text, printer)
        line = kept[text]
        if line is None:
            refused += 1
            if refused == LIMITS.max_refused:
                break
        elif line and line.code not in _MOVES:
            others.append((number, line))
    return tuple(others)


def _read_line(text: bytes, printer: Printer) -> GcodeLine | None:
    """Read one line; None for one that is refused elsewhere."""
    try:
        return read_line(text, printer)
    except LineError:
        return None
