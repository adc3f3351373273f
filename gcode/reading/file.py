"""Read a G-code file; collect each line's interpretation and errors."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

from firmware_profiles import Printer
from gcode.errors import LineError
from gcode.reading.line import (
    LIMITS,
    GcodeLine,
    Lines,
    plain_command,
    refusal,
    translator_of,
)
from gcode.reading.read import PLAIN_MOVE, read_line, read_words
from gcode.user_files import text_of

_REMEMBERED: Final = 10_000
_MOVES: Final = frozenset({"G0", "G1"})
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
    others : tuple of (int, GcodeLine)
        Lines that aren't moves.
    per_second : tuple of (int, bool) or None
        Lines from which on F counts per second, or per minute, and it is per second before; None
        where it is per minute throughout.
    """

    lines: list[bytes]
    refused: tuple[tuple[int, LineError], ...]
    others: Lines
    per_second: tuple[tuple[int, bool], ...] | None = None

    @property
    def in_g_code(self) -> bytes:
        """The file with named commands put into the words of G-code, as many lines."""
        lines = list(self.lines)
        for number, line in named_lines(self.others):
            lines[number - 1] = plain_command(line.code, line.parameters)
        return b"\n".join(lines)


def named_lines(lines: Lines) -> Lines:
    """Return the lines whose command has a name."""
    return tuple((number, line) for number, line in lines if line.is_named)


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
        written = translate(gcode if gcode.endswith(b"\n") else gcode + b"\n", printer, head)
        read = _read_lines(written.gcode, printer, read_words, max_refused)
        named = dict(written.named)
        others = tuple((number, named.get(number, line)) for number, line in read.others)
        refused = tuple(sorted((*read.refused, *written.refused), key=lambda one: one[0]))
        return replace(read, refused=refused, others=others, per_second=written.per_second)
    return _read_lines(gcode, printer, read_line, max_refused)


def _read_lines(gcode: bytes, printer: Printer, reader: LineReader, max_refused: int) -> GcodeFile:
    lines = gcode.splitlines()
    is_plain = PLAIN_MOVE.fullmatch
    unusual = [index for index, text in enumerate(lines) if not is_plain(text)]
    refused: list[tuple[int, LineError]] = []
    others: list[tuple[int, GcodeLine]] = []
    seen: dict[bytes, GcodeLine | LineError] = {}
    for index in unusual:
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
            if read and read.code not in _MOVES:
                others.append((index + 1, read))
    return GcodeFile(lines, tuple(refused), tuple(others))


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
    for line, error in refused:
        first.setdefault(error.sort, (line, error))
    count = Counter(error.sort for _, error in refused)
    for sort, (line, error) in first.items():
        yield line, error, count[sort]
