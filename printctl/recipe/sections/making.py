"""Recipe sections on the printer, its heads, and how a print is supervised."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from firmware_profiles.materials.inks_and_baths import check_viability
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


_Coordinate = Annotated[float, Field(ge=-10_000, le=10_000)]


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
