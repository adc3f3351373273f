"""Profile section for several heads: tip offset, select, raise and lower commands of each.

Places in a job are the carriage's, told as where the first head's tip stands when it is lowered;
the tip of head k stands `offset_mm` from there, and `raised_mm` higher while it is raised. The
writer takes the offset off (the host knows it), so the firmware must add none.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from firmware_profiles.families.registry import find_family
from firmware_profiles.strict_model import StrictModel, SwitchCommand

MOST_HEADS = 8
Length = Annotated[float, Field(ge=-500, le=500, allow_inf_nan=False)]
SelectCommand = Annotated[
    str,
    Field(pattern=r"^[A-Z][A-Z0-9_]*( [A-Za-z0-9_=]+)*$", max_length=64),
]
"""The firmware family says how it must be (`Family.head_select`)."""


class Offset(StrictModel):
    """Of a head's tip from the first head's, both lowered, mm."""

    x: Length = 0.0
    y: Length = 0.0
    z: Length = 0.0

    @property
    def mm(self) -> tuple[float, float, float]:
        """x, y and z."""
        return self.x, self.y, self.z


class Head(StrictModel):
    """One of several heads. What it doesn't say of its plunger is the printer's own."""

    name: str = Field(min_length=1, max_length=40)
    select: SelectCommand = Field(description="Makes it the one that E moves; moves nothing.")
    offset_mm: Offset = Field(
        default=Offset(), description="Its tip from the first head's; `printctl calibrate offset`."
    )
    raised_mm: Annotated[float, Field(ge=0, le=200, allow_inf_nan=False)] = Field(
        default=0.0, description="How much higher its tip stands while raised; 0 for a fixed head."
    )
    raises: SwitchCommand | None = Field(
        default=None, description="Raises it, e.g. M280 P0 S90 (a servo); needs raised_mm."
    )
    lowers: SwitchCommand | None = Field(
        default=None, description="Lowers it; the same command with another value."
    )
    moving_s: Annotated[float, Field(ge=0, le=30, allow_inf_nan=False)] = Field(
        default=0.5, description="Waited for after raising or lowering it."
    )
    plunger_steps_per_mm: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    max_plunger_mm_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    plunger_travel_mm: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    max_plunger_force_n: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None

    @model_validator(mode="after")
    def _is_raised_by_something(self) -> Head:
        if self.raises is None or self.lowers is None:
            if self.raised_mm > 0 or self.raises or self.lowers:
                raise ValueError(
                    f"head {self.name!r} is raised by {self.raised_mm:g} mm (raised_mm): give "
                    "raises and lowers too, or none of the three for a fixed head"
                )
            return self
        one, other = self.raises.split(), self.lowers.split()
        if one == other or one[0].upper() != other[0].upper():
            raise ValueError(
                f"raises {self.raises!r} and lowers {self.lowers!r} must be one command with two "
                "values (M280 P0 S90 and M280 P0 S10)"
            )
        if self.raised_mm == 0:
            raise ValueError(f"head {self.name!r} is raised by 0 mm; give raised_mm")
        return self

    @property
    def moves(self) -> bool:
        """Whether it can be raised."""
        return self.raises is not None


def check_heads(heads: tuple[Head, ...], firmware: str, *, plunger: bool) -> None:
    """Refuse heads that contradict each other.

    Raises
    ------
    ValueError
        For one head alone, a first one with an offset, two that are chosen alike, a firmware
        whose change of heads isn't known, or a pneumatic printer.
    """
    if not heads:
        return
    if not 2 <= len(heads) <= MOST_HEADS:
        raise ValueError(
            f"{len(heads)} heads; name 2 to {MOST_HEADS} of them, or none for a single one"
        )
    family = find_family(firmware)
    if family.head_select is None:
        raise ValueError(f"heads: how {firmware} changes between them isn't known; use one")
    if not plunger:
        raise ValueError("heads: only plungers can be several; a valve is watched over for one")
    if any(heads[0].offset_mm.mm):
        raise ValueError(
            "heads: the first one's offset_mm isn't 0; places are its tip's, so give the others' "
            "from it"
        )
    for what in ("name", "select"):
        values = [getattr(head, what) for head in heads]
        if len(set(values)) < len(values):
            raise ValueError(f"heads: two have the same {what} ({', '.join(values)})")
    for number, head in enumerate(heads):
        chosen = family.head_number(head.select)
        if chosen is None:
            raise ValueError(
                f"heads: {firmware} isn't told by {head.select!r} which head to use; write "
                f"{family.head_example}"
            )
        if chosen != number:
            raise ValueError(f"heads: {head.select!r} doesn't choose head {number}; order them")
