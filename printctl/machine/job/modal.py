"""Commanded needle and plunger position after a given number of job lines; compare with M114."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from firmware_profiles.families import meanings
from firmware_profiles.families.grammar import Meaning
from printctl.machine.job.heads import head_chosen
from sim.gcode.reading import code_of, is_motion, read_sent

_PLACING: Final = (b"G0", b"G1", b"G2", b"G3", b"G92")
HOMING: Final = (b"G28", b"G29")
_KEPT: Final = "XYZEF"
AXES: Final = "XYZE"


@dataclass(frozen=True)
class Modal:
    """Coordinates as they were last commanded; None when the job never did.

    Attributes
    ----------
    x, y, z : float or None, mm
    e : float or None, mm
        Plunger, absolute, as counted since the last ``G92 E``.
    f : float or None, mm/min
        Modal feed rate.
    """

    x: float | None = None
    y: float | None = None
    z: float | None = None
    e: float | None = None
    f: float | None = None

    def place(self) -> dict[str, float]:
        """Return what is known of x, y, z and e, mm, by name."""
        known = ((axis, getattr(self, axis)) for axis in AXES.lower())
        return {axis: value for axis, value in known if value is not None}

    def place_axes(self) -> str:
        """Return the axes, by their letters, whose place is known."""
        return "".join(name.upper() for name in self.place())

    def filled(self, place: Mapping[str, float]) -> Modal:
        """Return it with what isn't known taken from a ``place``."""
        return replace(self, **{**place, **self.place()})


def modal_state(lines: Sequence[bytes], done: int) -> Modal:
    """Read back from line ``done`` - 1 until every word has been found, or homing.

    Parameters
    ----------
    lines : sequence of bytes
        Job lines; absolute coordinates throughout (`printctl.machine.job.job` refuses others).
    done : int
        How many of them were taken.
    """
    return Modal(**_read_back(lines, 0, done)[0])


def places(lines: Sequence[bytes], done: int) -> dict[str, float]:
    """Return what `modal_state` finds of X, Y, Z and E, mm, by the axis' letter."""
    at = modal_state(lines, done)
    known = ((axis, getattr(at, axis.lower())) for axis in AXES)
    return {axis: value for axis, value in known if value is not None}


class ModalTrail:
    """`modal_state` again and again as a job goes on: each line is read about once.

    Parameters
    ----------
    lines : sequence of bytes
        As for `modal_state`.
    """

    def __init__(self, lines: Sequence[bytes]) -> None:
        self._lines, self._done, self._words = lines, 0, dict[str, float]()

    def grow(self, lines: Sequence[bytes]) -> None:
        """Take a job that has got lines behind those that were read."""
        self._lines = lines

    def at(self, done: int) -> Modal:
        """Where needle and plunger are after ``done`` lines."""
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
                if letter in _KEPT and value is not None:
                    words.setdefault(letter.lower(), value)
            if len(words) == 5:
                break
        else:
            words = {axis.lower(): mm for axis, mm in declared_axes(line).items()} | words
    return words, False


def disagreement(modal: Modal, position: dict[str, float], within_mm: float = 0.011) -> str:
    """Say where job text and printer differ by more than the printer's two decimals; or nothing."""
    apart = (
        (axis, getattr(modal, axis.lower())) for axis in mismatched_axes(modal, position, within_mm)
    )
    return ", ".join(
        f"{axis} is {position[axis]:.2f} mm where the job says {mm:.2f} mm" for axis, mm in apart
    )


def mismatched_axes(modal: Modal, position: dict[str, float], within_mm: float = 0.011) -> str:
    """Axes, by their letters, that stand elsewhere than the job says."""
    expected = {axis: getattr(modal, axis.lower()) for axis in AXES}
    return "".join(
        axis
        for axis, mm in expected.items()
        if mm is not None and abs(position.get(axis, mm) - mm) > within_mm
    )


def axes_placed(lines: Sequence[bytes]) -> str:
    """Axes, by their letters, that moves among ``lines`` bring to a place of their own.

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
    """How far the job itself has drawn the plunger back just before line ``done``, mm.

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
    """The last line before ``done`` that has one of ``codes``; None without one."""
    return next((line for line in reversed(lines[:done]) if code_of(line) in codes), None)


def declared_axes(line: bytes) -> dict[str, float]:
    """Axes that a line says the tip stands at, mm; empty where it says nothing of them."""
    code = code_of(line)
    if code != b"G92" and meanings().get(code.decode("ascii")) is not Meaning.PLACES:
        return {}
    read = read_sent(line)
    named = {axis: float(read.parameters[axis]) for axis in "XYZ" if axis in read.parameters}
    return named or {a: value for a in "XYZ" if (value := read.number(a)) is not None}
