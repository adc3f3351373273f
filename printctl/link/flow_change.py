"""Change how much ink the rest of a job pushes: E of its writing moves, from one line on.

The firmware's own flow factor (M221) isn't used: a reset forgets it, another program may change
it, and the journal couldn't say which lines were written under which. Scaled lines are lines like
all others: whoever reads the journal computes the same ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from printctl.link.errors import JobError

_MOVES: Final = (b"G1 ", b"G0 ", b"G2 ", b"G3 ")
_AXES: Final = (b" X", b" Y", b" Z")


def scaled_lines(
    lines: Sequence[bytes], after: int, e_mm: float, ratio: float, most_bytes: int
) -> list[bytes]:
    """Return a job's lines with the ink of the writing moves behind ``after`` scaled.

    Scaled is what a move pushes on its way. Primes, reliefs and what is drawn back on a way stay,
    since they don't write; ``G92 E`` begins a new count.

    Parameters
    ----------
    lines : sequence of bytes
        As they are sent; E is absolute.
    after : int
        Lines that stay.
    e_mm : float, mm
        Plunger's count behind those.
    ratio : float
        New ink over old.
    most_bytes : int
        Longest line that the firmware takes, number and checksum left out.

    Raises
    ------
    JobError
        When a scaled line would be too long.
    """
    found = list(lines[:after])
    old = new = e_mm
    for line in lines[after:]:
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
        scaled = b"%b E%.5f%b" % (line[:at], new, rest)
        if len(scaled) > most_bytes:
            raise JobError(
                f"{scaled.decode('ascii')} is longer than the {most_bytes} bytes that the firmware "
                "takes; the flow isn't corrected"
            )
        found.append(scaled)
    return found
