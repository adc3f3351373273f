"""Result of the needle shaft check of a job: each move's least distance from ink, JSON summary."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from kernels.arrays import FloatArray, IntArray
from sim.gcode.clearance.contact import ShaftContact, pairs_of
from sim.gcode.clearance.joints import DesignedOverlap


@dataclass(frozen=True)
class Clearance:
    """Approaches of the needles' bare shafts to what was written before, joints left out.

    Attributes
    ----------
    line, head, vessel : (n,) int64
        Of each move; vessel -1 for none.
    kind : (n,) int64
        Of `sim.gcode.clearance.heads.KINDS`.
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
