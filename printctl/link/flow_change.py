"""Change how much ink the rest of a job pushes: E of its writing moves.

The firmware's own flow factor (M221) isn't used: a reset forgets it, another program may change
it, and the journal couldn't say which lines were written under which. Scaled lines are lines like
all others: whoever reads the journal computes the same ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

_MOVES: Final = (b"G1 ", b"G0 ", b"G2 ", b"G3 ")
_AXES: Final = (b" X", b" Y", b" Z")


def scaled_lines(lines: Sequence[bytes], e_mm: float, ratio: float) -> list[bytes]:
    """Return the rest of a job with the ink of its writing moves scaled.

    Scaled is what a move pushes on its way. Primes, reliefs and what is drawn back on a way stay,
    since they don't write; ``G92 E`` begins a new count.

    Parameters
    ----------
    lines : sequence of bytes
        As they are sent; E is absolute.
    e_mm : float, mm
        Plunger's count before them.
    ratio : float
        New ink over old.
    """
    found = list[bytes]()
    old = new = e_mm
    for line in lines:
        at = line.find(b" E")
        if at < 0 or not line.startswith((*_MOVES, b"G92")):
            found.append(line)
            continue
        end = line.find(b" ", at + 1)
        rest = line[end:] if end >= 0 else b""
        e = float(line[at + 2 : end if end >= 0 else None])
        if line.startswith(b"G92"):
            old = new = e
            found.append(line)
            continue
        writes = e > old and any(axis in line for axis in _AXES)
        new += (e - old) * (ratio if writes else 1.0)
        old = e
        found.append(b"%b E%.5f%b" % (line[:at], new, rest))
    return found
