"""Check each move's needle shaft for contact with ink written before, from the G-code's motion.

Ink is kept as filaments in the order of time, their radius from what the plunger really pushes over
the length on which it does. For every move of every needle (writes, travels, lifts, changes of
head, needles that only ride along) the bare shaft's nearest approach to all ink written before is
found, exact to 2 µm (the proof is in `gcode.clearance.kernels`).

Left out is only the joint meant, of the reach J = sqrt(2) (R + r) + overlap: R the bare radius of
the thinnest needle's tip, r the larger filament's. Ink is a joint's

- of the vessel being written, within J along it of the tip's place;
- within J of a node along its vessel, the tip within J of it along its own: vessels that end there;
- within J of a place where the network overlaps itself (`gcode.clearance.network`), the tip,
too; - of no vessel (a purge), that the same pass wrote within an arc of J behind the tip.

A travel has the joint of the pass that it leaves, and of the one it goes to; its way from the one's
end or to the other's start adds to that along the vessel. What it rises or falls there doesn't
count: a needle that rises stands in the same ink as before.

Not looked at: ink pushed while the needle stands (primes); what settles or is dragged; the plate of
the syringe above the hub.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gcode.clearance.arrays import Ink, Joints, Tips
from gcode.clearance.kernels import FOUND, NeedleBody, search, squares_of
from gcode.clearance.motion import (
    KINDS,
    LIFT,
    NONE,
    Head,
    NeedleMotion,
    Pieces,
    heads_of,
    ink_of,
    kinds_of,
    tips_of,
)
from gcode.clearance.network import DesignedOverlap, WrittenNetwork, joints_of
from gcode.errors import ClearanceError
from kernels.arrays import FloatArray, IntArray

LOOK_MM = 1.0
"""Approaches beyond it aren't measured."""


def check_clearance(
    motion: NeedleMotion,
    network: WrittenNetwork,
    needles: Sequence[NeedleBody],
    overlap_radii: float = 0.0,
) -> Clearance:
    """Find each move's nearest approach of the shaft to what was written before it.

    Parameters
    ----------
    network : WrittenNetwork
        What is written, in the motion's frame.
    needles : sequence of NeedleBody
        One for each head.
    overlap_radii : float
        Overlap of joints, in radii of the filament.

    Raises
    ------
    ClearanceError
        For another count of needles than heads, or a vessel that the network hasn't.
    """
    _check(motion, network, needles, overlap_radii)
    pieces, heads = Pieces.of(motion.length_mm), heads_of(motion, network)
    ink, radius = ink_of(motion, network, heads, pieces)
    tips, row, head = tips_of(motion, heads, pieces, radius)
    tip = min(needle.tip_mm for needle in needles)
    clearance = max(needle.clearance_mm for needle in needles)
    joints, overlaps = joints_of(network, tip, overlap_radii)
    contacts = _searched(tips, ink, joints, needles, clearance, len(row))
    return SearchInput(motion, heads, pieces, tips, ink, row, head).clearance(
        *contacts, overlaps, clearance
    )


def _searched(
    tips: Tips,
    ink: Ink,
    joints: Joints,
    needles: Sequence[NeedleBody],
    clearance_mm: float,
    moves: int,
) -> tuple[Found, Found, Found]:
    """Nearest of each move, the same without joints, and what is nearer than the clearance."""
    room = moves
    while True:
        near, apart, hits = np.zeros(moves, FOUND), np.zeros(moves, FOUND), np.zeros(room, FOUND)
        near["value"] = apart["value"] = LOOK_MM
        near["ink"] = apart["ink"] = -1
        if not len(ink.when):
            return near, apart, hits[:0]
        bodies = np.stack([needle.as_row() for needle in needles])
        squares = squares_of(ink, _pitch(needles, ink))
        count = search(tips, ink, joints, bodies, squares, LOOK_MM, clearance_mm, near, apart, hits)
        if count <= room:
            return near, apart, hits[:count]
        room = count


def _pitch(needles: Sequence[NeedleBody], ink: Ink) -> float:
    """Of the squares: half of what is looked at round a tip."""
    return (max(one.widest_mm for one in needles) + float(ink.radius.max()) + LOOK_MM) / 2


def _check(
    motion: NeedleMotion,
    network: WrittenNetwork,
    needles: Sequence[NeedleBody],
    overlap_radii: float,
) -> None:
    if len(needles) != len(motion.tips):
        raise ClearanceError(f"{len(needles)} needles for {len(motion.tips)} heads; give one each")
    if not (np.isfinite(overlap_radii) and overlap_radii >= 0):
        raise ClearanceError(f"overlap_radii is {overlap_radii:g}; give a number of 0 or more")
    highest = int(motion.vessel.max(initial=-1))
    if highest >= network.vessel_count:
        raise ClearanceError(
            f"the map names vessel {highest}, and the network has {network.vessel_count} (from "
            "0): they aren't of one job; write both anew"
        )
    if not np.isfinite(motion.tips).all():
        raise ClearanceError("the G-code has places that are no numbers; write it anew")


Found = NDArray[Any]


@dataclass(frozen=True)
class SearchInput:
    """What the search looks at, and as which moves: ``row`` and ``head`` (moves,)."""

    motion: NeedleMotion
    heads: list[Head]
    pieces: Pieces
    tips: Tips
    ink: Ink
    row: IntArray
    head: IntArray

    def clearance(
        self,
        near: Found,
        apart: Found,
        hits: Found,
        overlaps: tuple[DesignedOverlap, ...],
        clearance_mm: float,
    ) -> Clearance:
        """Of what the search found: (moves,) and (hits,) of `FOUND`."""
        kind, vessel = self._moves()
        known = near["ink"] >= 0
        place, nearest = np.full((len(known), 3), np.nan), np.full(len(known), NONE)
        place[known] = self._on_ink(near[known])
        nearest[known] = near["vessel"][known]
        contacts = self._contacts(hits, kind, vessel)
        return Clearance(
            self.motion.line[self.row],
            self.head,
            vessel,
            kind,
            np.where(known, near["value"], np.inf),
            np.where(apart["ink"] >= 0, apart["value"], np.inf),
            nearest,
            place,
            tuple(one for one in contacts if one.crosses),
            tuple(one for one in contacts if not one.crosses),
            overlaps,
            len(self.ink.when),
            clearance_mm,
        )

    def _contacts(self, hits: Found, kind: IntArray, vessel: IntArray) -> list[ShaftContact]:
        hits = hits[np.lexsort((hits["move"], hits["value"]))]
        move, line = hits["move"], self.motion.line
        written = self.ink.when[hits["ink"]]
        columns: tuple[list[Any], ...] = (
            line[self.row[move]].tolist(),
            [KINDS[one] for one in kind[move].tolist()],
            self.head[move].tolist(),
            [_or_none(one) for one in vessel[move].tolist()],
            [_or_none(one) for one in hits["vessel"].tolist()],
            line[self.pieces.row[written]].tolist(),
            np.round(-hits["value"], 4).tolist(),
            [tuple(one) for one in np.round(self._on_ink(hits), 4).tolist()],
            [tuple(one) for one in np.round(self._on_tip(hits), 4).tolist()],
        )
        return [ShaftContact(*one) for one in zip(*columns, strict=True)]

    def _moves(self) -> tuple[IntArray, IntArray]:
        """Kind and vessel of each move."""
        motion = self.motion
        kind, vessel = np.zeros(len(self.row), np.int64), np.full(len(self.row), NONE)
        for k, one in enumerate(self.heads):
            own = self.head == k
            rows = self.row[own]
            kinds = kinds_of(one.tips, motion.writes & (motion.tool == k))[rows]
            last, following = one.passes.last[rows], one.passes.next[rows]
            left = ((kinds == LIFT) & (last >= 0)) | (following < 0)
            source = np.where(left, last, following)
            kind[own] = kinds
            vessel[own] = np.where(source >= 0, motion.vessel[source], NONE)
        return kind, vessel

    def _on_ink(self, hits: Found) -> FloatArray:
        j, t, ink = hits["ink"], hits["t"][:, None], self.ink
        return np.asarray(ink.start[j] + t * (ink.end[j] - ink.start[j]))

    def _on_tip(self, hits: Found) -> FloatArray:
        i, s, tips = hits["piece"], hits["s"][:, None], self.tips
        return np.asarray(tips.start[i] + s * (tips.end[i] - tips.start[i]))


def _or_none(vessel: int) -> int | None:
    return vessel if vessel >= 0 else None


@dataclass(frozen=True)
class ShaftContact:
    """A move whose shaft passes through a vessel's ink, or by it nearer than the clearance.

    Attributes
    ----------
    line : int
        Of the G-code, from 1.
    kind : str
        Of `gcode.clearance.motion.KINDS`.
    head : int
        Whose needle.
    vessel : int or None
        Being written; of a lift the one left, of another travel the one gone to.
    crossed : int or None
        Whose ink; None for ink of no vessel.
    crossed_line : int
        Line that wrote it.
    depth_mm : float, mm
        How far the bare shaft reaches into the filament; more than its diameter when the axis is
        well inside the shaft. Negative where it passes by at that distance.
    place_mm, tip_mm : (x, y, z), mm
        On the axis of the ink; of the tip meanwhile.
    """

    line: int
    kind: str
    head: int
    vessel: int | None
    crossed: int | None
    crossed_line: int
    depth_mm: float
    place_mm: tuple[float, float, float]
    tip_mm: tuple[float, float, float]

    @property
    def crosses(self) -> bool:
        """Whether the needle itself is in the ink."""
        return self.depth_mm > TOUCH_MM

    def sentence(self) -> str:
        """For people."""
        x, y, z = self.place_mm
        own = "" if self.vessel is None else f" for vessel {self.vessel}"
        other = "ink of no vessel" if self.crossed is None else f"vessel {self.crossed}"
        if self.depth_mm > 0:
            what = f"drives the shaft {self.depth_mm:.3f} mm into {other}"
        else:
            what = f"takes the shaft past {other} at {-self.depth_mm:.3f} mm"
        return (
            f"line {self.line} ({self.kind}{own}) {what}, written by line {self.crossed_line}, at "
            f"x {x:.2f}, y {y:.2f}, z {z:.2f} mm (printer's frame)"
        )


@dataclass(frozen=True)
class Clearance:
    """Approaches of the needles' bare shafts to what was written before, joints left out.

    Attributes
    ----------
    line, head, vessel : (n,) int64
        Of each move; vessel -1 for none.
    kind : (n,) int64
        Of `gcode.clearance.motion.KINDS`.
    approach_mm, apart_mm : (n,) float64, mm
        Nearest approach, and that to ink with which the move has no joint anywhere; negative where
        the shaft crosses, inf where nothing is near.
    nearest : (n,) int64
        Vessel that is nearest; -1 for none.
    place_mm : (n, 3) float64, mm
        Where, on the ink's axis; NaN for none.
    crossings, grazes : tuple of ShaftContact
        The deepest first, one for each move and vessel: where the needle is in the ink, and where
        it keeps less than the clearance.
    overlaps : tuple of DesignedOverlap
        Of the network itself, the deepest first: the shaft passes there as through a joint.
    written : int
        Filament pieces that were looked at.
    clearance_mm : float, mm
        To be kept.
    """

    line: IntArray
    head: IntArray
    vessel: IntArray
    kind: IntArray
    approach_mm: FloatArray
    apart_mm: FloatArray
    nearest: IntArray
    place_mm: FloatArray
    crossings: tuple[ShaftContact, ...]
    grazes: tuple[ShaftContact, ...]
    overlaps: tuple[DesignedOverlap, ...]
    written: int
    clearance_mm: float

    @property
    def pairs(self) -> int:
        """Crossings counted once for each vessel being written and vessel crossed."""
        return pairs_of(self.crossings)

    @property
    def grazed_pairs(self) -> int:
        """Grazes counted in the same way."""
        return pairs_of(self.grazes)

    def summary(self) -> dict[str, Any]:
        """The whole job in numbers, JSON-ready; an approach is None where nothing came near."""
        best = int(self.approach_mm.argmin()) if len(self.line) else 0
        approached = len(self.line) > 0 and bool(np.isfinite(self.approach_mm[best]))
        apart = float(self.apart_mm.min(initial=np.inf))
        return {
            "moves": len(self.line),
            "written_pieces": self.written,
            "nearest_mm": round(float(self.approach_mm[best]), 4) if approached else None,
            "nearest_line": int(self.line[best]) if approached else None,
            "nearest_apart_mm": round(apart, 4) if np.isfinite(apart) else None,
            "clearance_mm": self.clearance_mm,
            "crossings": len(self.crossings),
            "crossed_pairs": self.pairs,
            "grazes": len(self.grazes),
            "grazed_pairs": self.grazed_pairs,
            "own_overlaps": len(self.overlaps),
        }

    def as_dict(self) -> dict[str, Any]:
        """The summary, and every crossing, graze and overlap, JSON-ready."""
        return {
            **self.summary(),
            "crossing": [asdict(contact) for contact in self.crossings],
            "graze": [asdict(contact) for contact in self.grazes],
            "overlap": [asdict(contact) for contact in self.overlaps],
        }


TOUCH_MM: Final = 0.005
"""Deeper is a crossing: the text's rounding and the motors' steps leave places as uncertain."""


def pairs_of(contacts: tuple[ShaftContact, ...]) -> int:
    """Counted once for each vessel being written and vessel crossed."""
    return len({(contact.vessel, contact.crossed) for contact in contacts})
