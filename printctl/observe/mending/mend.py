"""Data class of a planned mend: lines to insert, patches, gaps left, volume, duration."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from printctl.observe.mending.gap import NotMended
from printctl.observe.mending.laid_ink import LaidInk, joined_ink
from printctl.observe.mending.patch import Patch


@dataclass(frozen=True, eq=False)
class Mend:
    """Insert that mends gaps.

    Attributes
    ----------
    lines : tuple of bytes
        To be inserted where the print is held; none where nothing can be mended.
    patches : tuple of Patch
        In the order in which they are written.
    spans : tuple of (int, int)
        Lines of the insert that write each patch: the first, and the one behind the last.
    left : tuple of NotMended
    volume_ul : float, µL
        Ink that comes out of the needle, a purge's included.
    duration_s : float, s
        Of the insert, by the dry run.
    """

    lines: tuple[bytes, ...]
    patches: tuple[Patch, ...]
    spans: tuple[tuple[int, int], ...]
    left: tuple[NotMended, ...]
    volume_ul: float
    duration_s: float

    def ink(self) -> LaidInk:
        """Return the ink that is expected to lie there after the mend, besides what did."""
        if self.patches:
            return joined_ink([patch.ink() for patch in self.patches])
        nothing = np.zeros((0, 3))
        return LaidInk(nothing, nothing, np.zeros(0), np.zeros(0), np.zeros(0, np.int64))

    def as_dict(self) -> dict[str, Any]:
        """Return what a journal keeps of it, JSON-ready."""
        return {
            "lines": [line.decode("ascii") for line in self.lines],
            "patches": [_patch_facts(patch) for patch in self.patches],
            "left": [asdict(one) for one in self.left],
            "volume_ul": round(self.volume_ul, 5),
            "duration_s": round(self.duration_s, 2),
        }

    def sentences(self) -> list[str]:
        """Return the mend in words, for the operator."""
        said = [
            f"path {p.path.number}: {p.gap.length_mm:.2f} mm written again, with {p.before_mm:.2f} "
            f"and {p.beyond_mm:.2f} mm on sound ink"
            for p in self.patches
        ]
        if self.patches:
            said.append(f"{self.volume_ul:.3f} µL of ink, {self.duration_s:.0f} s")
        return said + [
            f"path {one.path}: {one.length_mm:.2f} mm not mended: {one.reason}" for one in self.left
        ]

    def left_words(self) -> str:
        """Return how much isn't mended, by reason; empty for nothing."""
        ways = dict[str, float]()
        for one in self.left:
            ways[one.reason] = ways.get(one.reason, 0.0) + one.length_mm
        return "; ".join(f"{way:.2f} mm ({reason})" for reason, way in ways.items())


def _patch_facts(patch: Patch) -> dict[str, Any]:
    return {
        "path": patch.path.number,
        "from_mm": round(float(patch.gap.from_mm), 4),
        "to_mm": round(float(patch.gap.to_mm), 4),
        "before_mm": round(float(patch.before_mm), 4),
        "beyond_mm": round(float(patch.beyond_mm), 4),
        "flow": round(float(patch.flow), 4),
        "backwards": patch.backwards,
    }
