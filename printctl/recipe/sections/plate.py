"""Recipe section on a well plate: wells, copies, and values varied between wells."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from printctl.recipe.parts import Part, PlateName
from printctl.recipe.sections.making import PrinterPart
from printctl.recipe.sections.toolpath import Embedded, ToolpathPart

Millimetres = Annotated[float, Field(allow_inf_nan=False)]
WellName = Annotated[str, Field(min_length=2, max_length=8)]


def _several(value: Any) -> Any:
    """Names in one line as a list of them: A1, B1..B3."""
    if not isinstance(value, str) or value == "all":
        return value
    return value.replace(",", " ").split()


WellNames = Annotated[Literal["all"] | tuple[WellName, ...] | None, BeforeValidator(_several)]
_ALONE = ("dish", "dish_centre_mm", "bath_depth_mm", "place_mm")


class PlatePart(Part):
    """A part in each of several wells, in one job."""

    profile: PlateName
    wells: WellNames = Field(
        default=None,
        description="Names and blocks (A1, B1..B3, A1..D2); by default as many as are asked for, "
        "from A1 along the rows.",
    )
    copies: Annotated[int, Field(ge=1, le=2000)] | None = Field(
        default=None,
        description="Wells for each variant; by default what the wells named hold, else one.",
    )
    sweep: dict[str, Annotated[tuple[Any, ...], Field(min_length=1, max_length=1000)]] = Field(
        default={}, description="Recipe key (toolpath.write_speed_mm_s, ink.flow_factor) to values."
    )
    combine: Literal["grid", "list"] = Field(
        default="grid",
        description="grid: every value with every other; list: the first values of all keys "
        "together, then the second ones …",
    )
    bath_depth_mm: Annotated[float, Field(gt=0, le=500)] | None = Field(
        default=None, description="How high each well is filled."
    )
    a1_mm: tuple[Millimetres, Millimetres] | None = Field(
        default=None,
        description="Centre of A1 in the printer's frame; by default the plate's middle is in the "
        "middle of the work area.",
    )
    turned_deg: Literal[0, 90, 180, 270] = Field(
        default=0, description="Seen from above, against the clock; at 0 A1 is behind on the left."
    )
    scanned: WellNames = Field(
        default=None,
        description="Wells whose scan is held against the design; by default the first one alone.",
    )

    @model_validator(mode="after")
    def _lists_are_as_long_as_each_other(self) -> PlatePart:
        lengths = {key: len(values) for key, values in self.sweep.items()}
        if self.combine == "list" and len(set(lengths.values())) > 1:
            counts = ", ".join(f"{key} {count}" for key, count in lengths.items())
            raise ValueError(f"combine: list takes as many values of each key; there are {counts}")
        for name in ("wells", "scanned"):
            if getattr(self, name) == ():
                raise ValueError(f"{name} names no well; leave it out, or name some")
        return self


def check_plate(printer: PrinterPart, toolpath: ToolpathPart) -> None:
    """Refuse what a plate has no meaning for, or what isn't built for it.

    Raises
    ------
    ValueError
        With the key and the remedy.
    """
    given = [name for name in _ALONE if getattr(printer, name) is not None]
    if given:
        raise ValueError(
            f"printer.{given[0]} is of one dish, and plate gives each part a well of its own; "
            "leave it out (plate.bath_depth_mm, plate.a1_mm)"
        )
    if printer.heads:
        raise ValueError(
            "plate and printer.heads: a job over a plate is written by one head; other heads would "
            "stand in wells beside it, which isn't planned for; take a printer with one"
        )
    if toolpath.prime is not None:
        raise ValueError(
            "plate and toolpath.prime: nothing is purged or written before the part on a plate; "
            "leave prime out"
        )
    if isinstance(toolpath, Embedded) and toolpath.compensate_lag:
        raise ValueError(
            "plate and toolpath.compensate_lag: the plunger isn't driven ahead of the lag across "
            "wells; leave compensate_lag out, or print without a plate"
        )
