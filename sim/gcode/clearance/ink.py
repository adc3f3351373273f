"""Model written ink as filaments, radii from pushed volume and design, for the shaft check."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from kernels.arrays import FloatArray, IntArray
from sim.gcode.clearance.bodies import Ink
from sim.gcode.clearance.heads import Head
from sim.gcode.clearance.motion import NeedleMotion
from sim.gcode.clearance.network import WrittenNetwork
from sim.gcode.clearance.pieces import Pieces

WINDOW_MM: Final = 0.5
"""Volume over length is taken over at least so much of a pass: E's digits are coarse in a short
move."""


def ink_of(
    motion: NeedleMotion, network: WrittenNetwork, heads: list[Head], pieces: Pieces
) -> tuple[Ink, FloatArray]:
    """Return the written ink as filaments, and the radius that each row writes, (n,), mm.

    The network says how a vessel tapers, r_n(x), and the plunger how thick it is: r = r_n sqrt(V /
    V_n), V being pushed over `WINDOW_MM` of its pass, and V_n what the network has there.
    """
    chosen = np.flatnonzero(motion.writes[pieces.row])
    row = pieces.row[chosen]
    part = pieces.of_rows(chosen)
    start, end, run, arc = _written(motion, heads, part)
    vessel = motion.vessel[row]
    along, design = network.spans(vessel, start, end)
    share = _share(motion, part, run, vessel, design)
    radius = design * np.sqrt(share)[:, None]
    of_row = np.zeros(len(motion.line))
    np.maximum.at(of_row, row, radius.max(axis=1, initial=0.0))
    ink = Ink(start, end, radius, chosen.astype(np.int64), run, vessel, arc, along)
    left = np.flatnonzero(share > 0)
    columns: list[Any] = [column[left] for column in ink]
    return Ink(*columns), of_row


def _written(
    motion: NeedleMotion, heads: list[Head], part: Pieces
) -> tuple[FloatArray, FloatArray, IntArray, FloatArray]:
    """Ends of written pieces, the passes that they are of, and the way written in them before."""
    row = part.row
    start, end = np.zeros((len(row), 3)), np.zeros((len(row), 3))
    run, arc = np.zeros(len(row), np.int64), np.zeros((len(row), 2))
    begun = 0
    for k, head in enumerate(heads):
        own = motion.tool[row] == k
        a, b = part.places(head.tips)
        start[own], end[own] = a[own], b[own]
        run[own] = head.passes.run[row[own]] + begun
        arc[own] = part.values(head.passes.arc)[own]
        begun += int(head.passes.run.max(initial=-1)) + 1
    return start, end, run, arc


def _share(
    motion: NeedleMotion, part: Pieces, run: IntArray, vessel: IntArray, design: FloatArray
) -> FloatArray:
    """What is pushed, by what the network has there, (k,), over a window that stays in its pass."""
    length = (part.high - part.low) * motion.length_mm[part.row]
    volume = (part.high - part.low) * motion.volume_ul[part.row]
    r0, r1 = design.T
    meant = np.pi / 3 * length * (r0**2 + r0 * r1 + r1**2)
    path, pushed, planned = (np.append(0.0, np.cumsum(each)) for each in (length, volume, meant))
    changes = np.append(True, (np.diff(run) != 0) | (np.diff(vessel < 0) != 0))[: len(run)]
    which = np.cumsum(changes) - 1
    cuts = np.append(np.flatnonzero(changes), len(run))
    middle, half = (path[:-1] + path[1:]) / 2, np.maximum(length, WINDOW_MM) / 2
    low = np.maximum(middle - half, path[cuts[which]])
    high = np.minimum(middle + half, path[cuts[which + 1]])
    taken, known = (
        np.interp(high, path, each) - np.interp(low, path, each) for each in (pushed, planned)
    )
    return np.asarray(np.maximum(taken, 0.0) / np.maximum(known, 1e-12))
