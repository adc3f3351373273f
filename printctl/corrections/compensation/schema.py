"""Schema of the compensation file: design, print conditions, corrections and their evidence."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from printctl.recipe.parts import Part

Number = Annotated[float, Field(allow_inf_nan=False)]
Three = tuple[Number, Number, Number]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class DesignPart(Part):
    """Which design it belongs to."""

    network_sha256: Sha256
    solid_sha256: Sha256
    bounds_mm: Annotated[tuple[Three, Three], Field(description="Of the construct.")]


class PrintConditions(Part):
    """How the prints were made that it was measured on."""

    method: Literal["fresh", "embedded"]
    printer: str
    needle: str
    ink: str
    bath: str
    layer_um: Number | None = None
    line_um: Number | None = None


class PrintPart(Part):
    """A print that it rests on."""

    folder: str
    recipe_sha256: Sha256
    registration_sha256: Sha256
    scan_sha256: Sha256 | None
    compensation_sha256: Sha256 | None = Field(
        default=None, description="Of the compensation that this print was itself made with."
    )
    scale: Three
    scale_interval_95: tuple[Number | None, Number | None, Number | None]


class StretchPart(Part):
    """The part as a whole."""

    factor: Three = Field(default=(1.0, 1.0, 1.0), description="Written over designed, x, y, z.")
    about_mm: Three = Field(description="What stays in place: the middle, at the foot's height.")
    depth: str = Field(default="", description="Why z was or wasn't corrected.")


class RadialPart(Part):
    """Every lumen's radius, linear in its designed diameter."""

    offset_um: Number = 0.0
    slope_um_per_mm: Number = 0.0
    at_mm: Number = 0.0
    from_mm: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    to_mm: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 1000.0


class VesselPart(Part):
    """One vessel's diameter."""

    vessel: Annotated[int, Field(ge=0)]
    diameter_um: Number


class NodePart(Part):
    """One node's place."""

    node: Annotated[int, Field(ge=0)]
    offset_um: Three


class GainPart(Part):
    """How much of what was measured is corrected at once."""

    whole: Annotated[float, Field(gt=0, le=1)] = 1.0
    local: Annotated[float, Field(gt=0, le=1)] = 0.7


class CompensationFile(Part):
    """The whole file."""

    schema_version: Literal[1] = Field(alias="printctl_compensation")
    design: DesignPart
    made_with: PrintConditions
    simulated: bool = Field(description="Whether a simulated scan is among its evidence.")
    prints: Annotated[tuple[PrintPart, ...], Field(min_length=1)]
    gain: GainPart = GainPart()
    stretch: StretchPart
    radial: RadialPart = RadialPart()
    vessels: tuple[VesselPart, ...] = ()
    nodes: tuple[NodePart, ...] = ()
    evidence: dict[str, Any] = Field(default={}, description="Measured and decided; not read.")
    notes: tuple[str, ...] = ()
