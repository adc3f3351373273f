"""Recipe section of simulated print defects, planted into a simulated scan.

A place is given along a vessel of the design. None of this touches a real print; the report of a
run with defects says so in its scan section.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from printctl.recipe.parts import Length, Part, Point

Vessel = Annotated[int, Field(ge=0, description="Its number in network.csv.")]
Share = Annotated[float, Field(ge=0, le=1, description="How far along the vessel, of its length.")]


class BulgePart(Part):
    """The wall stands back: all round, or towards one side."""

    defect: Literal["bulge"]
    vessel: Vessel
    at: Share = 0.5
    length_mm: Length = Field(default=1.0, description="Nearly all of it lies within.")
    height_um: Annotated[float, Field(gt=0, le=5000)] = 60.0
    towards: Point | None = Field(default=None, description="Direction; all round by default.")


class StenosisPart(Part):
    """The lumen narrows and widens again."""

    defect: Literal["stenosis"]
    vessel: Vessel
    at: Share = 0.5
    length_mm: Length = Field(default=1.5, description="Nearly all of it lies within.")
    percent: Annotated[float, Field(gt=0, le=100)] = Field(
        default=50.0, description="By how much the diameter is less in the throat."
    )


class OcclusionPart(Part):
    """Gel fills the lumen over a stretch."""

    defect: Literal["occlusion"]
    vessel: Vessel
    at: Share = 0.5
    length_mm: Length = 1.0


class MissingPart(Part):
    """The vessel isn't there."""

    defect: Literal["missing"]
    vessel: Vessel


class LeakPart(Part):
    """A straight round hole from a vessel's axis through the gel."""

    defect: Literal["leak"]
    vessel: Vessel
    at: Share = 0.5
    diameter_um: Annotated[float, Field(gt=0, le=5000)] = 250.0
    to: Point = Field(description="Where it leads: beyond the part's surface, or another vessel.")


DefectPart = Annotated[
    BulgePart | StenosisPart | OcclusionPart | MissingPart | LeakPart,
    Field(discriminator="defect"),
]
