"""Inserts for tests: a stroke beside a job, and the way back."""

from __future__ import annotations

from collections.abc import Sequence

from printctl.machine.job.marks import MarkKind
from tests.printctl.machine.link.jobs import parse_job


def patch(data: bytes, layer: int) -> list[str]:
    """Lines that write a short stroke beside the end of a layer of `layered`, and come back."""
    job = parse_job(data, "a")
    mark = next(one for one in job.marks.of(MarkKind.LAYER) if one.number == layer)
    return patch_at(data, mark.index, layer)


def patch_at(data: bytes, done: int, layer: int = 0) -> list[str]:
    """The same behind so many command lines."""
    at = at_end(parse_job(data, "a").lines, done)
    x, y, z, e, f = at["X"], at["Y"], at["Z"], at["E"], at["F"]
    return [
        f"G1 Z{z + 0.5:.3f} F300",
        f"G1 X51.5 Y{50.25 + layer:.3f} F3000 ; beside it",
        f"G1 Z{z - 0.1:.3f} F300",
        f"G1 E{e + 0.25:.5f} F60",
        f"G1 X52.5 E{e + 0.26:.5f} F600",
        f"G1 E{e + 0.01:.5f} F60",
        f"G1 Z{z + 0.5:.3f} F300",
        f"G1 X{x:g} Y{y:g} F3000",
        f"G1 Z{z:g} F300",
        f"G92 E{e:.5f}",
        f"G1 F{f:g}",
    ]


def at_end(lines: Sequence[bytes], done: int) -> dict[str, float]:
    """Place, plunger and feed after so many lines, read word by word."""
    found = dict.fromkeys("XYZEF", 0.0)
    for line in lines[:done]:
        if line.startswith((b"G0 ", b"G1 ", b"G92 ")):
            found |= {w[0]: float(w[1:]) for w in line.decode().split()[1:] if w[0] in found}
    return found
