"""Recipe section on the toolpath: layers or filaments, compensation, priming before the part."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from firmware_profiles.tools import THINNEST_BORE
from printctl.recipe.parts import FILE, NeedleName, Part
from printctl.recipe.sections.regions import FillingPart, RegionPart

_Place = Annotated[
    tuple[float, float, float], Field(description="Of the tip: x, y, z in the printer's frame, mm")
]


class PrimePart(Part):
    """Purge over a waste cup, wipe, and a line in the bath beside the part."""

    line_mm: Annotated[float, Field(ge=0, le=500)] = Field(
        default=10.0, description="Length of the line; 0 for none."
    )
    gap_mm: Annotated[float, Field(gt=0, le=200)] = Field(
        default=3.0, description="How far it lies beside the part's bounds."
    )
    purge_ul: Annotated[float, Field(ge=0, le=10_000)] = Field(
        default=0.0, description="Pushed out over the cup, by each head."
    )
    cup_mm: _Place | None = Field(default=None, description="Where the tip stands for that.")
    wipe_mm: _Place | None = Field(
        default=None, description="Where it goes then, straight, along a wiper."
    )

    @model_validator(mode="after")
    def _a_purge_has_a_cup(self) -> PrimePart:
        if (self.purge_ul > 0) != (self.cup_mm is not None):
            raise ValueError(
                "purge_ul and cup_mm go together: say how much ink, and where the tip stands over "
                "the waste cup"
            )
        if self.wipe_mm is not None and self.cup_mm is None:
            raise ValueError("wipe_mm is where the tip goes from cup_mm; give both, or neither")
        if self.line_mm == 0 and self.purge_ul == 0:
            raise ValueError("neither line_mm nor purge_ul is above 0; leave prime out")
        return self


Percent = Annotated[float, Field(ge=-30, le=30, allow_inf_nan=False)]
Speed = Annotated[float, Field(gt=0, le=1000)]
ThinnestBore = Annotated[
    float,
    Field(
        ge=0.05,
        le=2,
        description="Thinnest line or filament, as a part of the needle's bore. Below about 0.8 "
        "the tip outruns the ink and draws it thinner than the bore; try it on the ink first.",
    ),
]
CompensationName = Annotated[
    str | None,
    Field(
        min_length=1,
        description="File of `printctl compensate`, relative to the recipe.",
        json_schema_extra=FILE,
    ),
]


class CompensationPart(Part):
    """What an earlier print of the same ink came out like, so that this one comes out right."""

    shrink_percent: tuple[Percent, Percent, Percent] = Field(
        default=(0.0, 0.0, 0.0), description="x, y, z; the report's scales, measured."
    )
    radial_um: Annotated[float, Field(ge=-1000, le=1000)] = Field(
        default=0.0, description="By how much a lumen's radius came out too small."
    )


class Fresh(FillingPart):
    """Layers of the solid, lumens left open, in a support bath."""

    method: Literal["fresh"]
    needle: NeedleName = "fresh_150um"
    layer_um: Annotated[float, Field(ge=10, le=2000)] = 60.0
    thinnest_layer_um: Annotated[float, Field(ge=5, le=2000)] | None = Field(
        default=None,
        description="Layers down to this height where walls are slanted; all alike by default.",
    )
    stair_um: Annotated[float, Field(ge=1, le=500)] = Field(
        default=20.0,
        description="With thinnest_layer_um: depth of a slanted wall's stair from which on layers "
        "become thinner.",
    )
    line_um: Annotated[float, Field(ge=20, le=5000)] = 150.0
    thinnest_bore: ThinnestBore = THINNEST_BORE
    walls: Annotated[int, Field(ge=1, le=50)] = Field(
        default=2, description="Lines along every boundary, counted from the lumen outward."
    )
    regions: Annotated[tuple[RegionPart, ...], Field(max_length=100)] = Field(
        default=(), description="Places with an infill of their own."
    )
    compensate: CompensationPart = CompensationPart()
    compensation: CompensationName = None
    prime: PrimePart | None = Field(default=None, description="Before the part; nothing without.")
    write_speed_mm_s: Speed = Field(default=20.0, description="Of writing.")
    travel_speed_mm_s: Speed = 40.0

    @model_validator(mode="after")
    def _compensated_once(self) -> Fresh:
        if self.compensation is not None and self.compensate != CompensationPart():
            raise ValueError(
                "compensate and compensation are both given; leave compensate out: a file made "
                "from a print that had it holds it already"
            )
        return self

    @model_validator(mode="after")
    def _thinner_layers_are_thinner(self) -> Fresh:
        thinnest = self.thinnest_layer_um
        # By value: a run's manifest holds every key, defaults too, and is read again.
        if thinnest is None and self.stair_um != Fresh.model_fields["stair_um"].default:
            raise ValueError(
                f"stair_um is {self.stair_um:g}, and all layers are alike; give thinnest_layer_um, "
                "or leave stair_um out"
            )
        if thinnest is not None and thinnest >= self.layer_um:
            raise ValueError(
                f"thinnest_layer_um is {thinnest:g}, and layer_um {self.layer_um:g}; the thinnest "
                "layer must be thinner: lower it, or leave it out"
            )
        return self

    @property
    def style(self) -> tuple[Literal["layered"], float]:
        """How ink lies, and how high the lines are where there is but one layer, mm."""
        return "layered", self.layer_um * 1e-3

    @property
    def written(self) -> Literal["layers"]:
        """What the ink is to become."""
        return "layers"

    @property
    def even_layer_mm(self) -> float | None:
        """Height of all layers, mm; None where they differ and the G-code says each."""
        return self.layer_um * 1e-3 if self.thinnest_layer_um is None else None

    def files(self) -> list[str]:
        """Names of the user's files that it is made from."""
        names = [name for region in self.regions for name in region.files()]
        return names + ([self.compensation] if self.compensation else [])


class Embedded(Part):
    """Vessels, or solid cords, written along their centrelines into a bath."""

    method: Literal["embedded"]
    writes: Literal["vessels", "cords"] = Field(
        default="vessels",
        description="vessels: a sacrificial ink leaves lumens in a bath that stays; cords: the ink "
        "stays, as solid filaments.",
    )
    needle: NeedleName = "30g"
    write_speed_mm_s: Speed = 5.0
    travel_speed_mm_s: Speed = 20.0
    overlap_radii: Annotated[float, Field(ge=0, le=5)] = Field(
        default=0.0,
        description="How far a pass continues past the centreline that it joins, in radii of the "
        "thinner vessel.",
    )
    allowed_crossings: Annotated[int, Field(ge=0, le=1_000_000)] = Field(
        default=0,
        description="Pairs of vessels, one written and one that the shaft may pass through.",
    )
    open_joints: Annotated[int, Field(ge=0, le=1_000_000)] = Field(
        default=0,
        description="How many joints may stay without an overlap; more are refused.",
    )
    leave_out: bool = Field(
        default=False,
        description="Vessels that can't be written in any order without the needle passing through "
        "ink aren't written; each is named with what would have to change.",
    )
    thinnest_bore: ThinnestBore = THINNEST_BORE
    widest_filament_mm: Annotated[float, Field(gt=0, le=20)] | None = Field(
        default=None,
        description="Wider vessels are written as strands side by side. By default what the "
        "plunger's flow fills at the slowest speed.",
    )
    compensate_lag: bool = Field(
        default=False,
        description="Drive the plunger ahead of the ink's measured lag (`lag` of its profile).",
    )
    compensation: CompensationName = None
    prime: PrimePart | None = Field(default=None, description="Before the part; nothing without.")

    @property
    def style(self) -> tuple[Literal["embedded"], None]:
        """How ink lies: as round filaments, level or not."""
        return "embedded", None

    @property
    def written(self) -> Literal["vessels", "cords"]:
        """What the ink is to become."""
        return self.writes

    def files(self) -> list[str]:
        """Names of the user's files that it is made from."""
        return [self.compensation] if self.compensation else []


ToolpathPart = Annotated[Fresh | Embedded, Field(discriminator="method")]
