"""Options of FRESH layers: layer height, line width, walls, infill, speeds, retraction."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np

from design.errors import ToolpathError
from design.solids.solid import Solid
from design.toolpath.toolpath import check_fields
from firmware_profiles.materials.bead import BeadSection

DENSEST_GYROID: Final = 0.7
"""A gyroid denser than this would write over itself."""
MAX_SHRINKAGE_PERCENT: Final = 30.0
"""More than this isn't shrinkage but a wrong number."""
Infill = Literal["lines", "concentric", "gyroid"]


@dataclass(frozen=True)
class Filling:
    """What fills the inside of the walls.

    Attributes
    ----------
    pattern : "lines", "concentric" or "gyroid"
    density : float
        Part of the inside that is filled; 1 is solid.
    angles_deg : tuple of float, °
        Direction of the lines, layer after layer in turn.
    """

    pattern: Infill = "lines"
    density: float = 1.0
    angles_deg: tuple[float, ...] = (0.0, 90.0)

    def __post_init__(self) -> None:
        if not 0 <= self.density <= 1:
            raise ToolpathError(
                f"infill_density is {self.density:g} (FRESH options); it must lie within 0 to 1"
            )
        if self.pattern == "gyroid" and self.density > DENSEST_GYROID:
            raise ToolpathError(
                f"infill_density is {self.density:g} (FRESH options); a gyroid's lines "
                f"meet above {DENSEST_GYROID:g}: choose lines, or less"
            )
        if not self.angles_deg or not all(map(math.isfinite, self.angles_deg)):
            raise ToolpathError(
                f"infill_angles_deg is {self.angles_deg} (FRESH options); give at least "
                "one finite angle"
            )


@dataclass(frozen=True)
class Compensation:
    """Shrinkage and wall offset that registration measured on an earlier print.

    Attributes
    ----------
    shrink_percent : (x, y, z) float
        How much shorter each axis came out than it was written.
    radial_mm : float, mm
        By how much a lumen's radius came out too small; below 0 for too large.
    """

    shrink_percent: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radial_mm: float = 0.0

    def __post_init__(self) -> None:
        worst = max(self.shrink_percent, key=abs)
        if not abs(worst) <= MAX_SHRINKAGE_PERCENT:
            raise ToolpathError(
                f"shrink_percent is {worst:g} (compensation); beyond {MAX_SHRINKAGE_PERCENT:g} % "
                "either way something else is wrong: measure again"
            )
        if not abs(self.radial_mm) <= 1.0:
            raise ToolpathError(
                f"radial_mm is {self.radial_mm:g} (compensation); it must lie within -1 to 1 mm"
            )

    def enlarged(self, solid: Solid) -> Solid:
        """The solid as it must be written, larger about its origin."""
        if not any(self.shrink_percent):
            return solid
        scale = 1.0 / (1.0 - np.array(self.shrink_percent) / 100.0)
        vertices = (solid.vertices * scale).astype(np.float32).astype(np.float64)
        return Solid(vertices, solid.faces)


@dataclass(frozen=True)
class Adaptive:
    """Layers thinner than `FreshOptions.layer_height_mm` where walls are slanted.

    Attributes
    ----------
    thinnest_mm : float, mm
        Lowest layer.
    stair_mm : float, mm
        Depth of a stair on a slanted wall, across the wall, above which layers become thinner.
    step_mm : float, mm
        Heights are whole multiples of it: of the vertical motor's step.
    """

    thinnest_mm: float
    stair_mm: float = 0.02
    step_mm: float = 2.5e-3

    def __post_init__(self) -> None:
        check_fields("adaptive layers", self, "thinnest_mm stair_mm step_mm")


@dataclass(frozen=True)
class FreshOptions:
    """Choices for FRESH layers; the defaults are the paper's 150 µm needle and 60 µm layers.

    Attributes
    ----------
    layer_height_mm, line_width_mm : float, mm
        Of a line as it lies there.
    adaptive : Adaptive or None
        Layers thinner than that where walls are slanted; None has all alike.
    bead : BeadSection
        Its cross-section, A: Q = A v.
    walls : int
        Lines of fixed width that follow every boundary, counted from the lumen outward.
    least_line : float
        Narrowest line that can be written, in line widths: with less flow, in places that are
        too thin for a whole one.
    filling : Filling
        Inside the walls, where no region says otherwise.
    lead_mm : float, mm
        How far from a lumen's wall, into the material, the plunger primes before it and relieves
        after it: what weeps there doesn't stand in the lumen.
    least_move_mm : float, mm
        Shortest move along a wall, along the longer of x and y: what the firmware doesn't merge.
    clear_mm : float, mm
        How far the ink keeps from every boundary, for what motors round: of the twenty points
        round a lumen the one that is rounded furthest into it counts.
    compensation : Compensation
        What the print will shrink by.
    write_speed_mm_s, travel_speed_mm_s, lift_speed_mm_s : float, mm/s
        While writing, travelling level, and going up or down.
    lift_mm : float, mm
        How far the needle rises before a travel that would cross an open lumen.
    hop_mm : float, mm
        How far it rises before any other travel that isn't a link, so as not to drag through
        fresh ink.
    link_mm : float, mm
        A level travel up to this length that crosses no lumen goes without retraction: the hop
        from one infill line to its neighbour. At 0 every travel retracts.
    joint_mm : float, mm
        Longest line along a wall that joins two neighbouring infill lines. 0 joins none: a head
        whose ink flows by time lays too much where the needle slows down to turn.
    retract_ul : float, µL
        Plunger relief before a travel; the same volume primes after it.
    plunger_ul_s : float, µL/s
        Flow while priming and retracting.
    """

    layer_height_mm: float = 0.06
    line_width_mm: float = 0.15
    adaptive: Adaptive | None = None
    bead: BeadSection = field(default_factory=BeadSection)
    walls: int = 2
    least_line: float = 0.4
    filling: Filling = field(default_factory=Filling)
    compensation: Compensation = field(default_factory=Compensation)
    write_speed_mm_s: float = 20.0
    travel_speed_mm_s: float = 40.0
    lift_speed_mm_s: float = 5.0
    lift_mm: float = 0.5
    hop_mm: float = 0.12
    lead_mm: float = 0.15
    least_move_mm: float = 0.0
    clear_mm: float = 0.0
    link_mm: float = 0.3
    joint_mm: float = 0.3
    retract_ul: float = 0.02
    plunger_ul_s: float = 0.4

    def __post_init__(self) -> None:
        check_fields(
            "FRESH options",
            self,
            "layer_height_mm line_width_mm write_speed_mm_s travel_speed_mm_s lift_speed_mm_s "
            "lift_mm plunger_ul_s",
            "link_mm joint_mm hop_mm lead_mm least_move_mm clear_mm retract_ul",
        )
        if not 0.2 <= self.least_line <= 1:
            raise ToolpathError(
                f"least_line is {self.least_line:g} (FRESH options); it must lie within 0.2 to 1"
            )
        if self.walls < 1:
            raise ToolpathError(
                f"walls is {self.walls} (FRESH options); without a wall the infill's line ends "
                "would stand in the lumens, so give at least 1"
            )

    def in_layer(self, height_mm: float) -> FreshOptions:
        """The same for a layer of another height."""
        if height_mm == self.layer_height_mm:
            return self
        return replace(self, layer_height_mm=height_mm)

    @property
    def spacing_mm(self) -> float:
        """Distance at which lines fill a layer, mm: their cross-section over their height."""
        return self.bead.spacing(self.line_width_mm, self.layer_height_mm)

    @property
    def inset_mm(self) -> float:
        """How far a line's edge stands beyond that of its rectangle of equal area, mm."""
        return (self.line_width_mm - self.spacing_mm) / 2

    @property
    def thinnest_wall_mm(self) -> float:
        """Thinnest wall that gets a line at all, mm; a thinner one is left out."""
        return self.least_line * self.spacing_mm + 2 * self.inset_mm

    @property
    def smallest_lumen_mm(self) -> float:
        """Smallest lumen that stays open, mm: two layers high and one line wide.

        A level lumen of diameter D is D/h layers of slots; below two layers rounding of the
        layer's height may close it. Nothing narrower than a line survives the spread of the
        lines beside it.
        """
        return max(2 * self.layer_height_mm, self.line_width_mm)

    @property
    def smallest_wall_mm(self) -> float:
        """Thinnest wall between two lumens, mm: one line of its own along either."""
        return 2 * self.line_width_mm
