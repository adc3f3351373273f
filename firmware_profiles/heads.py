"""Profile section for several heads: tip offset, valve, own axis, select and raise commands.

Places in a job are the carriage's, told as where the first head's tip stands when it is lowered;
the tip of head k stands `offset_mm` from there, and `raised_mm` higher while it is raised. The
writer takes the offset off (the host knows it), so the firmware must add none.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Annotated

from pydantic import Field, model_validator

from firmware_profiles.dispensers import Dispenser, Pneumatic
from firmware_profiles.families.registry import find_family
from firmware_profiles.strict_model import StrictModel, SwitchCommand, switched

MOST_HEADS = 8
Length = Annotated[float, Field(ge=-500, le=500, allow_inf_nan=False)]
SelectCommand = Annotated[
    str,
    Field(pattern=r"^[A-Z][A-Z0-9_]*( [A-Za-z0-9_=]+)*$", max_length=64),
]
"""The firmware family says how it must be (`Family.head_select`)."""
AxisLetter = Annotated[str, Field(pattern=r"^[A-DU-WZ]$")]


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
    """One of several heads. What it doesn't say of its dispenser is the printer's own."""

    name: str = Field(min_length=1, max_length=40)
    select: SelectCommand | None = Field(
        default=None,
        description="Makes it the one that E moves; moves nothing. None for pneumatic heads: the "
        "one whose valve opens is in use.",
    )
    z_axis: AxisLetter | None = Field(
        default=None,
        description="Letter of its own vertical axis, on a controller that runs the file: the "
        "other heads stand still meanwhile, above all that is written.",
    )
    dispenser: Dispenser | None = Field(
        default=None, description="Its own valve and pressure; the printer's dispenser if not."
    )
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
        switched(self.raises, self.lowers)
        if self.raised_mm == 0:
            raise ValueError(f"head {self.name!r} is raised by 0 mm; give raised_mm")
        return self

    @property
    def moves(self) -> bool:
        """Whether it can be raised."""
        return self.raises is not None


def check_heads(heads: tuple[Head, ...], firmware: str, dispenser: Dispenser) -> None:
    """Refuse heads that contradict each other.

    Parameters
    ----------
    heads : tuple of Head
    firmware : str
    dispenser : Dispenser
        The printer's, of heads that name none.

    Raises
    ------
    ValueError
        For one head alone, a first one with an offset, two that are chosen alike or share a valve,
        an axis or a place, a firmware whose change of heads isn't known, or plungers beside valves.
    """
    if not heads:
        return
    if not 2 <= len(heads) <= MOST_HEADS:
        raise ValueError(
            f"{len(heads)} heads; name 2 to {MOST_HEADS} of them, or none for a single one"
        )
    airs = [head.dispenser or dispenser for head in heads]
    if len({one.kind for one in airs}) > 1:
        raise ValueError("heads: plungers and valves on one printer can't be driven; name one kind")
    valves = [one for one in airs if isinstance(one, Pneumatic)]
    _check_outputs(outputs_of(heads, valves))
    by_file = bool(find_family(firmware).file_controllers)
    if valves and any(head.select for head in heads):
        raise ValueError("heads: select is for plungers; a valve says itself which is in use")
    if by_file:
        _check_axes(heads, pneumatic=bool(valves))
    elif any(head.z_axis for head in heads):
        raise ValueError(
            "heads: z_axis is for controllers that run the file (file_controller); leave it out, "
            "and say raises and lowers if each head is lifted by itself"
        )
    elif not valves:
        _check_selects(heads, firmware)
    if any(heads[0].offset_mm.mm):
        raise ValueError(
            "heads: the first one's offset_mm isn't 0; places are its tip's, so give the others' "
            "from it"
        )
    for one, other in combinations(heads, 2):
        if one.offset_mm.mm[:2] == other.offset_mm.mm[:2]:
            raise ValueError(
                f"heads: the tips of {one.name!r} and {other.name!r} would stand on each other "
                f"(offset_mm: x {one.offset_mm.x:g}, y {one.offset_mm.y:g}); measure the offset "
                "(`printctl calibrate offset`)"
            )
    names = [head.name for head in heads]
    if len(set(names)) < len(names):
        raise ValueError(f"heads: two have the same name ({', '.join(names)})")


def outputs_of(
    heads: Sequence[Head], airs: Sequence[Pneumatic]
) -> list[tuple[str, frozenset[str]]]:
    """Valve, pressure and lift of each head: a command of it, and what that sets."""
    lifts = [(one.raises, one.lowers) for one in heads if one.raises and one.lowers]
    return [
        *((air.opens, air.valve) for air in airs),
        *(("; ".join(air.sets_pressure), air.port) for air in airs if air.sets_pressure),
        *((raises, switched(raises, lowers)) for raises, lowers in lifts),
    ]


def _check_outputs(outputs: Sequence[tuple[str, frozenset[str]]]) -> None:
    for (one, first), (other, second) in combinations(outputs, 2):
        if first <= second or second <= first:
            raise ValueError(
                f"heads: {one!r} and {other!r} set the same output; give each valve, pressure and "
                "lift its own"
            )


def _check_axes(heads: tuple[Head, ...], *, pneumatic: bool) -> None:
    """Heads of a controller that runs the file: valves, with an axis of each or none."""
    if not pneumatic:
        raise ValueError(
            "heads: several plungers on a controller that runs the file can't be driven; use one, "
            "or pneumatic heads"
        )
    axes = [head.z_axis for head in heads if head.z_axis]
    if axes and any(head.offset_mm.z for head in heads):
        raise ValueError(
            "heads: offset_mm.z beside z_axis: each needle is touched off by its own axis; leave z "
            "out"
        )
    if axes and (len(set(axes)) < len(heads) or any(head.moves for head in heads)):
        raise ValueError(
            "heads: z_axis is for all heads or none, each another letter, and none of them raises"
        )


def _check_selects(heads: tuple[Head, ...], firmware: str) -> None:
    """Heads of a firmware that takes lines: each has its own number."""
    family = find_family(firmware)
    if family.head_select is None:
        raise ValueError(f"heads: how {firmware} changes between them isn't known; use one")
    for number, head in enumerate(heads):
        if head.select is None:
            raise ValueError(f"heads: head {number} has no select; write {family.head_example}")
        chosen = family.head_number(head.select)
        if chosen is None:
            raise ValueError(
                f"heads: {firmware} isn't told by {head.select!r} which head to use; write "
                f"{family.head_example}"
            )
        if chosen != number:
            raise ValueError(f"heads: {head.select!r} doesn't choose head {number}; order them")
