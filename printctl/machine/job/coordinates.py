"""Places that a job's lines command or declare: modal state, moves, frame, declared start."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Final, NamedTuple

from firmware_profiles import Printer
from firmware_profiles.families import family_of, meanings
from firmware_profiles.families.grammar import Meaning
from gcode.reading import code_of, is_motion, read_sent
from printctl.machine.errors import LinkError
from printctl.machine.job.dispensing import head_chosen
from printctl.machine.job.job import Job

HOMING: Final = (b"G28", b"G29")
AXES: Final = "XYZE"
Place = tuple[float, float, float]
_PLACING: Final = frozenset((b"G0", b"G1", b"G2", b"G3", b"G92"))
_WORDS: Final = {letter.encode(): k for k, letter in enumerate("XYZEF")}
_ROUNDING_MM: Final = 1e-9
"""Of sums of numbers with few decimals."""


@dataclass(frozen=True)
class Modal:
    """Coordinates as they were last commanded, mm; None when the job never did.

    ``e`` is the plunger's, absolute, as counted since the last ``G92 E``; ``f`` the modal feed
    rate, mm/min.
    """

    x: float | None = None
    y: float | None = None
    z: float | None = None
    e: float | None = None
    f: float | None = None

    def place(self) -> dict[str, float]:
        """Return what is known of x, y, z and e, mm, by name."""
        known = {"x": self.x, "y": self.y, "z": self.z, "e": self.e}
        return {axis: mm for axis, mm in known.items() if mm is not None}

    def place_axes(self) -> str:
        """Return the axes, by their letters, whose place is known."""
        return "".join(self.place()).upper()

    def filled(self, place: Mapping[str, float]) -> Modal:
        """Return it with what isn't known taken from a ``place``."""
        return replace(self, **{**place, **self.place()})


def modal_state(lines: Sequence[bytes], done: int) -> Modal:
    """Return the state after ``done`` lines of a job, all of whose coordinates are absolute."""
    return Modal(**_read_back(lines, 0, done)[0])


def places(lines: Sequence[bytes], done: int) -> dict[str, float]:
    """Return what `modal_state` finds of X, Y, Z and E, mm, by the axis' letter."""
    return {axis.upper(): mm for axis, mm in modal_state(lines, done).place().items()}


class ModalTrail:
    """`modal_state` again and again as a job of ``lines`` goes on: each is read about once."""

    def __init__(self, lines: Sequence[bytes]) -> None:
        self._lines, self._done, self._words = lines, 0, dict[str, float]()

    def grow(self, lines: Sequence[bytes]) -> None:
        """Take a job that has got lines behind those that were read."""
        self._lines = lines

    def at(self, done: int) -> Modal:
        """Return where needle and plunger are after ``done`` lines."""
        if done < self._done:  # lines were taken back
            self._done, self._words = 0, {}
        words, homed = _read_back(self._lines, self._done, done)
        self._words = words if homed else {**self._words, **words}
        self._done = done
        return Modal(**self._words)


def _read_back(lines: Sequence[bytes], first: int, done: int) -> tuple[dict[str, float], bool]:
    """Last words in lines ``first`` to ``done`` - 1, and whether homing ended the search."""
    words: dict[str, float] = {}
    for line in reversed(lines[first:done]):
        code = code_of(line)
        if code in HOMING:
            return words, True
        if code in _PLACING:
            for letter, value in read_sent(line).words.items():
                if letter in "XYZEF" and value is not None:
                    words.setdefault(letter.lower(), value)
            if len(words) == len(_WORDS):
                break
        else:
            words = {axis.lower(): mm for axis, mm in declared_axes(line).items()} | words
    return words, False


class Spot(NamedTuple):
    """Place of tip and plunger, mm, and feed rate, mm/min; NaN where unknown."""

    x: float = math.nan
    y: float = math.nan
    z: float = math.nan
    e: float = math.nan
    f: float = math.nan

    @classmethod
    def of(cls, at: Modal) -> Spot:
        """Return the place of a modal state."""
        return cls(*(math.nan if mm is None else mm for mm in (at.x, at.y, at.z, at.e, at.f)))


UNKNOWN: Final = Spot()


class Move(NamedTuple):
    """A move or arc of a job: its line, from 0, where it begins and ends, and how it is written."""

    line: int
    begin: Spot
    end: Spot
    text: bytes = b""

    @property
    def way_mm(self) -> float:
        """Straight length of the tip's way, mm, along the axes that are known at both ends."""
        way = math.dist(self.begin[:3], self.end[:3])
        if way == way:
            return way
        steps = (b - a for a, b in zip(self.begin[:3], self.end[:3], strict=True))
        return math.hypot(*(mm for mm in steps if mm == mm))

    @property
    def path_mm(self) -> float:
        """Length of the tip's way, mm, round where it is an arc."""
        if not self.text.startswith((b"G2 ", b"G3 ")):
            return self.way_mm
        dx, dy, dz = (b - a for a, b in zip(self.begin[:3], self.end[:3], strict=True))
        read, chord = read_sent(self.text), math.hypot(dx, dy)
        if chord != chord:
            return self.way_mm
        radius = read.number("R")
        if radius is not None:
            half = math.asin(min(1.0, chord / (2 * abs(radius))))
            arc = abs(radius) * 2 * (half if radius > 0 else math.pi - half)
        else:
            i, j = read.number("I") or 0.0, read.number("J") or 0.0
            turn = math.atan2(-j, -i) - math.atan2(dy - j, dx - i)
            turn = turn if read.code == "G2" else -turn
            arc = math.hypot(i, j) * (turn % (2 * math.pi) or 2 * math.pi)
        return math.hypot(arc, dz if dz == dz else 0.0) if arc else self.way_mm

    @property
    def push_mm_s(self) -> float:
        """Speed at which it pushes the plunger, mm/s; 0 where it doesn't, or nothing tells."""
        push, feed = self.end.e - self.begin.e, self.end.f
        if not (push > 0 and feed > 0):
            return 0.0
        return feed / 60 * (push / (self.path_mm or push))


def moves_of(
    lines: Sequence[bytes], first: int = 0, end: int | None = None, at: Spot = UNKNOWN
) -> Iterator[Move]:
    """Follow a job's lines from ``first`` to ``end`` - 1, and yield each move; ``at`` before."""
    for index in range(first, len(lines) if end is None else end):
        text = lines[index]
        code, *words = text.split(b" ")
        if code in _PLACING:
            to = list(at)
            for word in words:
                letter = word[:1]
                if letter in _WORDS and len(word) > 1:
                    to[_WORDS[letter]] = float(word[1:])
            before, at = at, Spot._make(to)
            if code != b"G92":
                yield Move(index, before, at, text)
        elif code in HOMING:
            at = Spot(e=at.e, f=at.f)
        elif code in _declaring():
            at = at._replace(**{a.lower(): mm for a, mm in declared_axes(text).items()})


def disagreement(modal: Modal, position: dict[str, float], within_mm: float = 0.011) -> str:
    """Say where job text and printer differ by more than the printer's two decimals; or nothing."""
    apart = (
        (axis, getattr(modal, axis.lower())) for axis in mismatched_axes(modal, position, within_mm)
    )
    return ", ".join(
        f"{axis} is {position[axis]:.2f} mm where the job says {mm:.2f} mm" for axis, mm in apart
    )


def mismatched_axes(modal: Modal, position: dict[str, float], within_mm: float = 0.011) -> str:
    """Return the axes, by their letters, that stand elsewhere than the job says."""
    expected = {axis.upper(): mm for axis, mm in modal.place().items()}
    return "".join(
        axis for axis, mm in expected.items() if abs(position.get(axis, mm) - mm) > within_mm
    )


def axes_placed(lines: Sequence[bytes]) -> str:
    """Return the axes, by their letters, that moves among ``lines`` bring to a place of their own.

    Up to a ``G92``, which would call a wrong place right.
    """
    axes: set[str] = set()
    for line in lines:
        if code_of(line) == b"G92" or declared_axes(line):
            break
        if is_motion(line):
            axes |= read_sent(line).words.keys() & set(AXES)
    return "".join(sorted(axes))


def relieved_mm(lines: Sequence[bytes], done: int) -> float:
    """Return how far the job itself has drawn the plunger back just before line ``done``, mm.

    0 when its last plunger move pushed, or the count was set anew (G92) since. Infinite where a
    head was chosen since: it was relieved when it was left, or has pushed nothing yet.
    """
    now: float | None = None
    for index in range(done - 1, -1, -1):
        line = lines[index]
        code = code_of(line)
        if code not in _PLACING:
            if head_chosen(line) is not None:
                return math.inf
            continue
        e = read_sent(line).number("E")
        if e is None:
            continue
        if now is None:
            now = e
        elif e != now:
            return max(0.0, e - now)
        if code == b"G92":
            changed = index > 0 and head_chosen(lines[index - 1]) is not None
            return math.inf if changed else 0.0
    return 0.0


def last_of(lines: Sequence[bytes], done: int, codes: tuple[bytes, ...]) -> bytes | None:
    """Return the last line before ``done`` that has one of ``codes``; None without one."""
    return next((line for line in reversed(lines[:done]) if code_of(line) in codes), None)


@cache
def _declaring() -> frozenset[bytes]:
    """Codes that say where the tip stands."""
    placing = (code.encode() for code, meaning in meanings().items() if meaning is Meaning.PLACES)
    return frozenset((b"G92", *placing))


def declared_axes(line: bytes) -> dict[str, float]:
    """Return the axes that a line says the tip stands at, mm; empty where it says nothing."""
    if code_of(line) not in _declaring():
        return {}
    read = read_sent(line)
    named = {axis: float(read.parameters[axis]) for axis in "XYZ" if axis in read.parameters}
    return named or {a: value for a in "XYZ" if (value := read.number(a)) is not None}


@dataclass(frozen=True)
class Renaming:
    """A line that says where the tip stands.

    ``declared`` are axes that nothing before it has named, mm. ``moved`` is by how much it calls
    other axes' places otherwise, mm; empty where it names the place that the job's text says
    anyway.
    """

    index: int
    line: bytes
    declared: dict[str, float]
    moved: dict[str, float]


@dataclass(frozen=True)
class JobFrame:
    """What a job's lines add to a place, counted from where the tip was touched off, mm.

    The first ``lines`` (without E), or else the checks, say that the tip stands at ``start``; None
    where the machine is homed. ``top`` is the greatest height of any move, as ``start`` counts.
    ``renamed`` are command lines that call a place otherwise, and what places are called beyond
    ``start``'s count from there on; in order.
    """

    start: Place | None
    lines: tuple[bytes, ...]
    top: float
    renamed: tuple[tuple[int, Place], ...] = ()

    def shift_at(self, index: int) -> Place:
        """Return what a place is called by command line ``index`` beyond ``start``'s count, mm."""
        before = self.renamed and bisect_right(self.renamed, index, key=lambda one: one[0])
        return self.renamed[before - 1][1] if before else (0.0, 0.0, 0.0)


def renamings(lines: Sequence[bytes], start_mm: Place | None = None) -> list[Renaming]:
    """Return the lines that say where the tip stands, in order; ``start_mm`` before the first."""
    trail, all_renamings = ModalTrail(lines), list[Renaming]()
    start = dict(zip("xyz", start_mm or (), strict=False))
    for index, line in enumerate(lines):
        axes = declared_axes(line)
        if not axes:
            continue
        at = start | trail.at(index).place()
        moved = {a: mm - at[a.lower()] for a, mm in axes.items() if a.lower() in at}
        declared = {axis: mm for axis, mm in axes.items() if axis not in moved}
        changed = {axis: mm for axis, mm in moved.items() if abs(mm) > _ROUNDING_MM}
        all_renamings.append(Renaming(index, line, declared, changed))
    return all_renamings


def declared_start(job: Job) -> Place | None:
    """Return the tip position that the job's first lines declare; None where they don't.

    Of each axis the first word before any move counts: what is named later renames places, and the
    dry run follows it. Raises `LinkError` where some of X, Y and Z are named there, or any is named
    behind a move, and not all three before it: nothing says then where the checks begin.
    """
    words: dict[str, float] = {}
    for line in job.lines:
        if code_of(line) == b"G28":
            return None  # homing finds the place; what is named behind it renames that
        if is_motion(line):
            break
        words = declared_axes(line) | words
    if set(words) == set("XYZ"):
        return words["X"], words["Y"], words["Z"]
    late = next((one for one in renamings(job.lines) if one.declared or one.moved), None)
    if late is None:
        return None
    raise LinkError(
        f"line {job.file_lines[late.index]} ({late.line.decode('ascii')}) sets the tip position, "
        "but X, Y and Z aren't all set before the first move: set all three there, or remove it"
    )


def frame_at(job: Job, begin: int, printer: Printer, start_mm: Place | None = None) -> JobFrame:
    """Return the frame of a job, and the commands that declare it before command line ``begin``.

    ``start_mm`` is where the checks took the tip to stand before the first line, mm; it counts for
    a job that declares some of X, Y and Z alone, or declares them late. Raises `LinkError` where a
    line says where the tip stands in a way that can't be followed.
    """
    named = renamings(job.lines)
    first = next((k for k, line in enumerate(job.lines) if is_motion(line)), len(job))
    early = {axis for one in named if one.index < first for axis in one.declared}
    renames = any(one.declared or one.moved for one in named)
    homes = any(code_of(line) == b"G28" for line in job.lines)
    start, lines = start_mm, tuple[bytes, ...]()
    checked = start is not None and renames and not homes and early != set("XYZ")
    if checked:  # behind the place of the checks
        named = renamings(job.lines, start)
    else:
        start, lines = _declared(job, named, first)
    top = _top(job, named)
    if start is None:  # what renames places behind ``begin`` stays in the rest
        _shifts(job, [one for one in named if one.index < begin], start)
        return JobFrame(None, lines, top)
    frame = JobFrame(start, lines, top, _shifts(job, named, start))
    if checked or any(frame.shift_at(begin - 1)):
        # where the printer keeps G92 apart, that as well
        declares = family_of(printer).dialect(printer).declares
        x, y, z = (f"{mm:.5f}" for mm in start)
        every = [one for one in (declares, "G92 X{x} Y{y} Z{z}") if one]
        return replace(frame, lines=tuple(one.format(x=x, y=y, z=z).encode() for one in every))
    return frame


def _declared(
    job: Job, named: Sequence[Renaming], first: int
) -> tuple[Place | None, tuple[bytes, ...]]:
    """Where the tip stands by the lines before the ``first`` move, and those lines without E."""
    declaring, at = [one for one in named if one.declared], dict[str, float]()
    if not declaring:
        return None, ()
    for one in declaring:
        at |= one.declared
        if one.index > first:
            _refuse(job, one, "sets the tip position after a move")
    if set(at) != set("XYZ"):
        _refuse(job, declaring[-1], "sets the tip position, but not all of X, Y and Z")
    words = (one.line.split(b" ") for one in declaring)
    lines = tuple(b" ".join(word for word in line if word[:1] != b"E") for line in words)
    return (at["X"], at["Y"], at["Z"]), lines


def _shifts(
    job: Job, named: Sequence[Renaming], start: Place | None
) -> tuple[tuple[int, Place], ...]:
    """Add up what lines call a place beyond the count of ``start``, mm."""
    total, shifts = dict.fromkeys("XYZ", 0.0), list[tuple[int, Place]]()
    for one in named:
        if not one.moved:
            continue
        by_name = code_of(one.line) != b"G92"  # leaves what G92 has shifted as it is
        if start is None or (by_name and any(total.values())):
            _refuse(job, one, "redefines a position that no line before the first move sets")
        for axis, mm in one.moved.items():
            total[axis] += mm
        x, y, z = (mm if abs(mm) > _ROUNDING_MM else 0.0 for mm in total.values())
        shifts.append((one.index, (x, y, z)))
    return tuple(shifts)


def _top(job: Job, named: Sequence[Renaming]) -> float:
    """Greatest height of the job's moves, mm, by the frame of its first lines."""
    by = {one.index: one.moved.get("Z", 0.0) for one in named}
    shift, top = 0.0, -math.inf
    for index, line in enumerate(job.lines):
        shift += by.get(index, 0.0)
        if b"Z" in line and is_motion(line):
            z = read_sent(line).number("Z")
            top = top if z is None else max(top, z - shift)
    return top


def _refuse(job: Job, one: Renaming, what: str) -> None:
    text = one.line.decode("ascii")
    raise LinkError(
        f"line {job.file_lines[one.index]} ({text}) {what}: after a loss of position the rest of "
        "the job can't be located; print the part again, with a job whose first lines set X, Y and "
        "Z"
    )
