"""Convert the shaft search's raw hits to contacts by G-code line, head and vessel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray
from sim.gcode.clearance.bodies import Ink, Tips
from sim.gcode.clearance.contact import ShaftContact
from sim.gcode.clearance.heads import KINDS, LIFT, Head, kinds_of
from sim.gcode.clearance.joints import DesignedOverlap
from sim.gcode.clearance.motion import NONE, NeedleMotion
from sim.gcode.clearance.pieces import Pieces
from sim.gcode.clearance.result import Clearance

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
