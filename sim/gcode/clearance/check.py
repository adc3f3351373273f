"""Check each move's needle shaft for contact with ink written before, from the G-code's motion.

Ink is kept as filaments in the order of time, their radius from what the plunger really pushes over
the length on which it does. For every move of every needle (writes, travels, lifts, changes of
head, needles that only ride along) the bare shaft's nearest approach to all ink written before is
found, exact to `ERROR_MM` (the proof is in `sim.gcode.clearance.pair_kernels`).

Left out is only the joint meant, of the reach J = sqrt(2) (R + r) + overlap: R the bare radius of
the thinnest needle's tip, r the larger filament's. Ink is a joint's

- of the vessel being written, within J along it of the tip's place;
- within J of a node along its vessel, the tip within J of it along its own: vessels that end there;
- within J of a place where the network overlaps itself (`sim.gcode.clearance.overlaps`), the tip,
too; - of no vessel (a purge), that the same pass wrote within an arc of J behind the tip.

A travel has the joint of the pass that it leaves, and of the one it goes to; its way from the one's
end or to the other's start adds to that along the vessel. What it rises or falls there doesn't
count: a needle that rises stands in the same ink as before.

Not looked at: ink pushed while the needle stands (primes); what settles or is dragged; the plate of
the syringe above the hub.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim.errors import ClearanceError
from sim.gcode.clearance.bodies import Ink, Joints, Tips
from sim.gcode.clearance.findings import Found, SearchInput
from sim.gcode.clearance.heads import heads_of
from sim.gcode.clearance.ink import ink_of
from sim.gcode.clearance.joints import joints_of
from sim.gcode.clearance.motion import NeedleMotion
from sim.gcode.clearance.needle import NeedleBody
from sim.gcode.clearance.network import WrittenNetwork
from sim.gcode.clearance.pieces import Pieces
from sim.gcode.clearance.result import Clearance
from sim.gcode.clearance.search_kernels import FOUND, search, squares_of
from sim.gcode.clearance.tips import tips_of

LOOK_MM = 1.0
"""Approaches beyond it aren't measured."""


def check_clearance(
    motion: NeedleMotion,
    network: WrittenNetwork,
    needles: Sequence[NeedleBody],
    overlap_radii: float = 0.0,
    look_mm: float = LOOK_MM,
) -> Clearance:
    """Find each move's nearest approach of the shaft to what was written before it.

    Parameters
    ----------
    motion : NeedleMotion
    network : WrittenNetwork
        What is written, in the motion's frame.
    needles : sequence of NeedleBody
        One for each head.
    overlap_radii : float
        Overlap of joints, in radii of the filament.
    look_mm : float, mm
        How far to look.

    Raises
    ------
    ClearanceError
        For another count of needles than heads, or a vessel that the network hasn't.
    """
    _check(motion, network, needles, overlap_radii, look_mm)
    pieces, heads = Pieces.of(motion.length_mm), heads_of(motion, network)
    ink, radius = ink_of(motion, network, heads, pieces)
    tips, row, head = tips_of(motion, heads, pieces, radius)
    tip = min(needle.tip_mm for needle in needles)
    clearance = max(needle.clearance_mm for needle in needles)
    joints, overlaps = joints_of(network, tip, overlap_radii)
    contacts = _searched(tips, ink, joints, needles, look_mm, clearance, len(row))
    return SearchInput(motion, heads, pieces, tips, ink, row, head).clearance(
        *contacts, overlaps, clearance
    )


def _searched(
    tips: Tips,
    ink: Ink,
    joints: Joints,
    needles: Sequence[NeedleBody],
    look_mm: float,
    clearance_mm: float,
    moves: int,
) -> tuple[Found, Found, Found]:
    """Nearest of each move, the same without joints, and what is nearer than the clearance."""
    room = moves
    while True:
        near, apart, hits = np.zeros(moves, FOUND), np.zeros(moves, FOUND), np.zeros(room, FOUND)
        near["value"] = apart["value"] = look_mm
        near["ink"] = apart["ink"] = -1
        if not len(ink.when):
            return near, apart, hits[:0]
        bodies = np.stack([needle.as_row() for needle in needles])
        squares = squares_of(ink, _pitch(needles, ink, look_mm))
        count = search(tips, ink, joints, bodies, squares, look_mm, clearance_mm, near, apart, hits)
        if count <= room:
            return near, apart, hits[:count]
        room = count


def _pitch(needles: Sequence[NeedleBody], ink: Ink, look_mm: float) -> float:
    """Of the squares: half of what is looked at round a tip."""
    return (max(one.widest_mm for one in needles) + float(ink.radius.max()) + look_mm) / 2


def _check(
    motion: NeedleMotion,
    network: WrittenNetwork,
    needles: Sequence[NeedleBody],
    overlap_radii: float,
    look_mm: float,
) -> None:
    if len(needles) != len(motion.tips):
        raise ClearanceError(f"{len(needles)} needles for {len(motion.tips)} heads; give one each")
    for name, value in (("overlap_radii", overlap_radii), ("look_mm", look_mm)):
        if not (np.isfinite(value) and value >= 0):
            raise ClearanceError(f"{name} is {value:g}; give a number of 0 or more")
    highest = int(motion.vessel.max(initial=-1))
    if highest >= network.vessel_count:
        raise ClearanceError(
            f"the map names vessel {highest}, and the network has {network.vessel_count} (from "
            "0): they aren't of one job; write both anew"
        )
    _check_finite(motion.tips)


def _check_finite(places: NDArray[np.float64]) -> None:
    if not np.isfinite(places).all():
        raise ClearanceError("the G-code has places that are no numbers; write it anew")
