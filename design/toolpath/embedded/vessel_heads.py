"""Data class of each vessel's print head with its needle and ink; clearances of all heads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.errors import ToolpathError
from design.network import VesselNetwork
from design.toolpath.embedded.filament import check_vessels
from design.toolpath.embedded.needle import Needle
from design.toolpath.embedded.options import EmbeddedOptions
from kernels.arrays import IntArray


@dataclass(frozen=True)
class EmbeddedHeads:
    """Heads of an embedded job, one or several.

    Attributes
    ----------
    options : tuple of EmbeddedOptions
        Of each head: its needle, its ink's relief, its speeds.
    vessel_head : (n,) int64
        The head of each vessel of the network.

    Raises
    ------
    ToolpathError
        For a vessel whose head isn't there.
    """

    options: tuple[EmbeddedOptions, ...]
    vessel_head: IntArray

    def __post_init__(self) -> None:
        wrong = np.flatnonzero((self.vessel_head < 0) | (self.vessel_head >= len(self.options)))
        if len(wrong):
            raise ToolpathError(
                f"vessel {int(wrong[0])} is given to head {int(self.vessel_head[wrong[0]])}; there "
                f"are {len(self.options)} (0 to {len(self.options) - 1})"
            )

    @staticmethod
    def one(options: EmbeddedOptions, network: VesselNetwork) -> EmbeddedHeads:
        """A single head writes all."""
        return EmbeddedHeads((options,), np.zeros(len(network.vessel_nodes), dtype=np.int64))

    def of(self, vessel: int) -> int:
        """The head that writes a vessel."""
        return int(self.vessel_head[vessel])

    @property
    def shaft_mm(self) -> float:
        """Radius that must stay free around any head's shaft, mm."""
        return max(one.shaft_mm for one in self.options)

    @property
    def bare_mm(self) -> tuple[float, float]:
        """Radius of the thinnest and of the widest head's tip, mm."""
        radii = [one.tip_mm - one.clearance_mm for one in self.options]
        return min(radii), max(radii)

    @property
    def tip_mm(self) -> float:
        """Radius that must stay free around any head's tip, mm."""
        return max(one.tip_mm for one in self.options)

    @property
    def cone_mm(self) -> float:
        """Height over which the tip widens to the shaft, mm; the shortest of all heads'."""
        return min(one.cone_mm for one in self.options)

    @property
    def leave_out(self) -> bool:
        """Whether vessels that can't be written without a crossing are left out."""
        return all(one.leave_out for one in self.options)

    @property
    def look_within(self) -> bool:
        """Whether passes name places to look."""
        return any(one.look_within for one in self.options)

    def needles(self) -> tuple[Needle, ...]:
        """Each head's needle without its clearance."""
        joint, widest = self.bare_mm
        return tuple(
            Needle(
                joint,
                widest,
                one.tip_mm - one.clearance_mm,
                one.shaft_mm - one.clearance_mm,
                one.cone_mm,
                self.overlap_radii,
            )
            for one in self.options
        )

    @property
    def overlap_radii(self) -> float:
        """The longest overlap of a joint, in radii."""
        return max(one.overlap_radii for one in self.options)

    def check(self, network: VesselNetwork) -> None:
        """Refuse vessels that their own head's needle can't write."""
        for number, options in enumerate(self.options):
            check_vessels(network, options, np.flatnonzero(self.vessel_head == number))
