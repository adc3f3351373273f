"""Check that every line of a file was executed once and in order, from what the printer did."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

_COMMAND = re.compile(rb"[GMT]\d")
_WHERE = re.compile(rb"M0*114(?!\d)")
_NUMBERED = re.compile(rb" *N(-?\d+) *")
_STATED_AGAIN = (b"G21", b"G90", b"M82")
"""Modes that a file begins with; taken again they change nothing, and who goes on states them."""


@dataclass(frozen=True)
class Taken:
    """A line that the printer took, as it arrived, number and checksum included.

    ``meant``: what the host had last sent under that number; None for a line without a number.
    """

    time_s: float
    text: bytes
    meant: bytes | None


@dataclass(frozen=True)
class Order:
    """What became of a file's lines.

    ``lost``, ``doubled``, ``swapped``: before the last taken one never taken; taken again; taken
    after a later one. ``unfinished``: after the last taken one. ``slipped``: taken with another
    text than was sent, which the checksum didn't show; ``slipped_beside``: the same of the host's
    own lines between them. ``strays``: taken without a number; ``unverified``: those that read like
    a command after which no M114 was sent before the file went on.
    """

    lost: int
    doubled: int
    swapped: int
    unfinished: int
    slipped: int
    slipped_beside: int
    strays: int
    unverified: int
    longest_gap_s: float


def body_of(text: bytes) -> tuple[int | None, bytes]:
    """A line's number (None without) and its command without number and checksum."""
    found = _NUMBERED.match(text)
    rest = text[found.end() :] if found else text
    return (int(found[1]) if found else None), rest.rpartition(b"*")[0] or rest


def since_renumbering(taken: Iterable[Taken]) -> list[Taken]:
    """What came after the last M110 that was meant; a print's own lines begin with it.

    Noise can make an M110 of an M114, and a check that passes; the print goes on behind that.
    """
    rows = list(taken)
    begins = [k for k, one in enumerate(rows) if (one.meant or b"").startswith(b"M110")]
    return rows[begins[-1] + 1 :] if begins else rows


def judge(file: Sequence[bytes], taken: Sequence[Taken]) -> Order:
    """Compare a file, no two lines of which are alike, with what the printer took."""
    place = {line: k for k, line in enumerate(file)}
    order, times, slipped, beside, strays = [], [], 0, 0, 0
    for one in since_renumbering(taken):
        number, text = body_of(one.text)
        if number is None or one.meant is None:
            strays += 1
            continue
        if one.meant in _STATED_AGAIN and place.get(one.meant) in order:
            beside += text.strip() != one.meant
        elif one.meant in place:
            order.append(place[one.meant])
            times.append(one.time_s)
            slipped += text.strip() != one.meant
        else:
            beside += text.strip() != one.meant
    count, last = Counter(order), max(order, default=-1)
    return Order(
        lost=sum(k not in count for k in range(last)),
        unfinished=len(file) - 1 - last,
        doubled=sum(n - 1 for n in count.values()),
        swapped=sum(b < a for a, b in pairwise(order)),
        slipped=slipped,
        slipped_beside=beside,
        strays=strays,
        unverified=_unverified(place, since_renumbering(taken)),
        longest_gap_s=float(np.max(np.diff(times), initial=0.0)),
    )


def _unverified(place: dict[bytes, int], taken: list[Taken]) -> int:
    """Fragments that may have been done, and after which nobody looked before going on."""
    found, open_now = 0, 0
    for one in taken:
        _, text = body_of(one.text)
        if one.meant is None:
            open_now += _COMMAND.match(text.strip()) is not None
        elif _WHERE.match(text.strip()):
            open_now = 0
        elif one.meant in place:
            found, open_now = found + open_now, 0
    return found


def unreached(expected: NDArray[np.int64], executed: NDArray[np.int64]) -> tuple[int, int]:
    """Count ends of moves (n, 4), steps, that weren't reached in order, and surplus ones."""
    rows = [tuple(row) for row in executed.tolist()]
    last_at: dict[tuple[int, ...], list[int]] = {}
    for index, row in enumerate(rows):
        last_at.setdefault(row, []).append(index)
    at, found = -1, 0
    for row in map(tuple, expected.tolist()):
        later = next((index for index in last_at.get(row, []) if index > at), None)
        if later is not None:
            at, found = later, found + 1
    return len(expected) - found, len(rows) - found
