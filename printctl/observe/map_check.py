"""Data class of what is known of a height map's rows and columns, and of the ground below ink."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MapCheck:
    """What tells whether a height map is whole.

    Attributes
    ----------
    lacks : str
        What it lacks, and against what, in words; empty for nothing.
    unsized : bool
        Whether nothing tells how many rows and columns it should have.
    sunk_mm : float, mm
        By how much the ground of the layer's ink has sunk at most, since it was designed.
    """

    lacks: str = ""
    unsized: bool = False
    sunk_mm: float = 0.0

    def worse(self, other: MapCheck) -> MapCheck:
        """Return what is to be said of two maps of one look."""
        return MapCheck(
            self.lacks or other.lacks,
            self.unsized or other.unsized,
            max(self.sunk_mm, other.sunk_mm),
        )
