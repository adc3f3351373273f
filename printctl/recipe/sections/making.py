"""Recipe sections on production and measurement: toolpath, printer, scan, registration."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from firmware_profiles.materials.inks_and_baths import check_viability
from firmware_profiles.tools import THINNEST_BORE
from printctl.recipe.parts import (
    FILE,
    BathName,
    DishName,
    InkName,
    NeedleName,
    Part,
    PrinterName,
    SyringeName,
)
from printctl.recipe.sections.regions import FillingPart, RegionPart

# Recipe section on print heads: ink, syringe, needle and assigned vessels of each.

Kind = Literal["artery", "vein", "lymph", "connection", "channel"]


class HeadPart(Part):
    """One head, in the order of the printer's profile."""

    syringe: SyringeName = "hamilton_1ml"
    ink: InkName = "collagen_fresh"
    needle: NeedleName | None = Field(default=None, description="toolpath.needle where not given.")
    kinds: tuple[Kind, ...] = Field(
        default=(), description="Vessels that it writes into a bath, by kind."
    )
    trees: tuple[Annotated[int, Field(ge=0)], ...] = Field(
        default=(), description="Or by the number of their tree, which counts before the kind."
    )

    @property
    def writes_the_rest(self) -> bool:
        """Whether it writes what no other head names."""
        return not (self.kinds or self.trees)


def check_heads(heads: tuple[HeadPart, ...]) -> None:
    """Refuse heads that claim the same vessels, or two that write the rest.

    Raises
    ------
    ValueError
        Naming what two heads claim.
    """
    for name in ("kinds", "trees"):
        claimed = [one for head in heads for one in getattr(head, name)]
        twice = {one for one in claimed if claimed.count(one) > 1}
        if twice:
            raise ValueError(f"heads: {name} {sorted(map(str, twice))[0]} is given to two of them")
    if sum(head.writes_the_rest for head in heads) > 1 and any(
        not head.writes_the_rest for head in heads
    ):
        raise ValueError("heads: two name neither kinds nor trees; only one can write the rest")


# Recipe section on priming: the needle's moves before the part.

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


# Recipe section on supervising a print: checkpoints, dead-man's time, syringes, cell lifetime.


class CarePart(Part):
    """What `printctl print` has options for."""

    checkpoint_every_s: Annotated[float, Field(ge=0, le=86_400)] | None = Field(
        default=30.0,
        description="Least time between two checks of the position, which are made where a layer "
        "or pass ends; 0 for each end, null for none.",
    )
    deadman_min: Annotated[float, Field(ge=0, le=1440)] = Field(
        default=0.0,
        description="Pause unless somebody confirms within so many min (printctl alive); 0 for an "
        "attended print.",
    )
    deadman_stops: bool = Field(
        default=False, description="Cancel the print then, instead of pausing."
    )
    reload: bool = Field(
        default=False, description="Pause for a new syringe where one doesn't last."
    )
    reload_min: Annotated[float, Field(gt=0, le=600)] | None = Field(
        default=None, description="How long one change takes you; unknown without."
    )
    viability_min: Annotated[float, Field(gt=0, le=100_000)] | None = Field(
        default=None,
        description="How long the print may take for its cells' sake, changes of syringe "
        "included; the ink's own (viability_min) by default.",
    )
    viability_source: Annotated[str, Field(min_length=1)] | None = Field(
        default=None, description="Where viability_min comes from."
    )
    prime_ul: Annotated[float, Field(ge=0, le=1000)] = Field(
        default=0.0, description="Ink to push in addition after a pause."
    )

    silent_limit_s: Annotated[float, Field(ge=10, le=86_400)] | None = Field(
        default=None,
        description="End the print when the printer gives no usable answer for so long; 60 s by "
        "default, 1800 s for one line of a firmware that can't be asked (Klipper, RepRapFirmware).",
    )
    noise_limit: Annotated[int, Field(ge=1, le=500)] = Field(
        default=30,
        description="Pause when more lines than this among 500 had to be sent again.",
    )

    @model_validator(mode="after")
    def _a_budget_has_a_source(self) -> CarePart:
        check_viability(self.viability_min, self.viability_source)
        return self

    @model_validator(mode="after")
    def _stop_has_a_time(self) -> CarePart:
        if self.deadman_stops and not self.deadman_min:
            raise ValueError("deadman_stops needs a time; give deadman_min")
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
_Coordinate = Annotated[float, Field(ge=-10_000, le=10_000)]
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


class PrinterPart(Part):
    """Which machine, with what in it."""

    profile: PrinterName = "generic_marlin"
    port: str = Field(
        default="simulated",
        min_length=1,
        description="A serial port, tcp:HOST:PORT, simulated, or a network host: "
        "moonraker://HOST:PORT, octoprint://HOST:PORT, duet://HOST.",
    )
    faults: str | None = Field(
        default=None,
        min_length=1,
        description="Fault file of the simulated printer: what its board, cable and ink suffer.",
        json_schema_extra=FILE,
    )
    syringe: SyringeName = "hamilton_1ml"
    ink: InkName = "collagen_fresh"
    bath: BathName = "gelatin_support"
    dish: DishName | None = Field(
        default=None, description="Its walls are looked at before printing, if given."
    )
    dish_centre_mm: (
        tuple[
            Annotated[float, Field(allow_inf_nan=False)],
            Annotated[float, Field(allow_inf_nan=False)],
        ]
        | None
    ) = Field(default=None, description="x, y in the printer's frame; below the part by default.")
    bath_depth_mm: Annotated[float, Field(gt=0, le=500)] | None = Field(
        default=None, description="How high the dish is filled."
    )
    place_mm: tuple[_Coordinate, _Coordinate, _Coordinate] | None = Field(
        default=None,
        description="Where the part's origin stands in the printer's frame; centred by default.",
    )
    heads: tuple[HeadPart, ...] = Field(
        default=(), description="Of a printer with several: what each holds and writes."
    )
    care: CarePart = Field(default=CarePart(), description="How the print is watched over.")

    @model_validator(mode="after")
    def _heads_agree(self) -> PrinterPart:
        check_heads(self.heads)
        given = self.model_fields_set & {"syringe", "ink"}
        if self.heads and given:
            raise ValueError(
                f"{' and '.join(sorted(given))} of the printer and its heads are both given; say "
                "it in heads alone"
            )
        return self

    @model_serializer(mode="wrap")
    def _said_in_heads_alone(self, whole: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """What is dumped can be read again: no syringe and ink beside those of the heads."""
        data: dict[str, Any] = whole(self)
        if self.heads:
            data.pop("syringe", None)
            data.pop("ink", None)
        return data

    @model_validator(mode="after")
    def _faults_are_simulated(self) -> PrinterPart:
        if self.faults is not None and self.port != "simulated":
            raise ValueError(
                f"faults are the simulated printer's, but port is {self.port}; leave faults out, "
                "or say port: simulated"
            )
        return self

    def files(self) -> list[str]:
        """Names of the user's files that it is made from."""
        return [] if self.faults is None else [self.faults]

    @model_validator(mode="after")
    def _bath_is_in_a_dish(self) -> PrinterPart:
        if self.dish is None and (self.bath_depth_mm is not None or self.dish_centre_mm):
            raise ValueError("bath_depth_mm and dish_centre_mm belong to a dish; name it (dish)")
        return self
