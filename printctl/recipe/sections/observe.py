"""Recipe section on observing a print: device, inspection interval, tolerances, allowed mends."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Final, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from printctl.inspection.options import GAP_LIMITS_MM, WIDTH_LIMITS_PERCENT
from printctl.recipe.parts import FILE, Part

_EVERY: Final = re.compile(r"(layer|vessel)|(\d+(?:\.\d+)?) *(mm|min|s)( +written)?")
_HIGHEST_MM: Final = 5.0
_SECONDS: Final = {"min": 60.0, "s": 1.0}

DeviceName = Literal["camera", "oct", "laser_line"]


@dataclass(frozen=True)
class LookInterval:
    """What lies between two looks.

    Attributes
    ----------
    measure : str
        ``layer`` or ``vessel``, where each ends; ``height`` gained, mm; ``time``, s by the clock;
        ``written_way``, mm, or ``written_time``, s, which end within layers as well.
    amount : float, mm or s
        0 for layer and vessel.
    """

    measure: Literal["layer", "vessel", "height", "time", "written_way", "written_time"]
    amount: float = 0.0


def look_interval(text: str) -> LookInterval:
    """Read ``every``.

    Raises
    ------
    ValueError
        For what isn't an interval, and for a height that is meant as a way.
    """
    found = _EVERY.fullmatch(text.strip())
    if found is None or (found[2] is not None and not float(found[2])):
        raise ValueError(
            f"{text!r} isn't a place to look at: say layer, vessel, a height gained (0.5 mm), a "
            "time by the clock (10 min), or what is written between looks (40 mm written, 10 s "
            "written); amounts are above 0"
        )
    if found[1]:
        return LookInterval("layer" if found[1] == "layer" else "vessel")
    amount, unit, written = float(found[2]), found[3], bool(found[4])
    if unit != "mm":
        return LookInterval("written_time" if written else "time", amount * _SECONDS[unit])
    if written:
        return LookInterval("written_way", amount)
    if amount > _HIGHEST_MM:
        raise ValueError(
            f"{text!r} would be a height gained between looks, and that is {_HIGHEST_MM:g} mm at "
            f"most; for a way of written lines say `{amount:g} mm written`"
        )
    return LookInterval("height", amount)


def _number_as_text(value: object) -> object:
    """Take a bare number as text, so that the message says which units there are."""
    return f"{value:g}" if type(value) in (int, float) else value


def _known_interval(text: str) -> str:
    look_interval(text)
    return text


def _camera_number(value: object) -> object:
    """Take a camera's number as people write it: YAML reads ``source: 0`` as no text."""
    return str(value) if type(value) is int and value >= 0 else value


class ObserveTolerances(Part):
    """Deviations that are let pass."""

    gap_mm: Annotated[float, Field(ge=GAP_LIMITS_MM[0], le=GAP_LIMITS_MM[1])] = Field(
        default=0.2, description="Shorter stretches without ink."
    )
    unseen_mm: Annotated[float, Field(ge=0.2, le=1000)] = Field(
        default=1.5,
        description="In a bath: stretches of a vessel, too faint or hidden to be told, that are "
        "let pass; about longer ones, and half of a shorter vessel, the operator is asked.",
    )
    width_percent: Annotated[
        float, Field(ge=WIDTH_LIMITS_PERCENT[0], le=WIDTH_LIMITS_PERCENT[1])
    ] = Field(default=15.0, description="Of a line's width; what exceeds it is told, not mended.")
    lumen_percent: Annotated[float, Field(ge=1, le=100)] = Field(
        default=10.0, description="By which a lumen may be seen narrower."
    )
    shift_mm: Annotated[float, Field(ge=0.01, le=5)] = Field(
        default=0.1, description="By which a layer may lie beside its place."
    )


class ObserveCosts(Part):
    """What goes wrong costs, in minutes of an operator; the action that costs least is taken."""

    operator: Annotated[float, Field(ge=0, le=1e4)] = Field(
        default=10.0, description="To be asked."
    )
    false_ink_mm: Annotated[float, Field(ge=0, le=1e6)] = Field(
        default=20.0, description="A millimetre of ink that is written onto sound ink."
    )
    missed_ink_mm: Annotated[float, Field(ge=0, le=1e6)] = Field(
        default=5.0, description="A millimetre of missing ink that is left so."
    )
    scrapped: Annotated[float, Field(ge=0, le=1e6)] = Field(
        default=600.0, description="A print that is lost."
    )


class ObservePart(Part):
    """How the print is looked at while it is made."""

    device: DeviceName
    source: Annotated[str, BeforeValidator(_camera_number)] = Field(
        default="",
        description="Number or address of a camera; a folder into which the device's own program "
        "writes; or that program's command, with {out} for the file to write. Without it, what the "
        "simulated printer laid is seen by a simulated device.",
    )
    frame: str | None = Field(
        default=None,
        description="Which place of the printer a pixel shows: file of `printctl observe frame`; "
        "of an OCT or laser line a file with printer_to_scan; of a laser line with a camera that "
        "of `printctl observe sweep`.",
        json_schema_extra=FILE,
    )
    every: Annotated[str, BeforeValidator(_number_as_text), AfterValidator(_known_interval)] = (
        Field(
            default="60 s written",
            description="Where a layer or vessel ends (vessel: also within one, before its rest "
            "bars the needle's way to what is written); or at the first such end behind a height "
            "gained (0.5 mm) or a time by the clock (10 min); or also within layers, where a line "
            "ends, behind so much writing: 40 mm written, 10 s written.",
        )
    )
    tolerance: ObserveTolerances = ObserveTolerances()
    costs: ObserveCosts = ObserveCosts()
    mend: Literal["tell", "ask", "mend"] = Field(
        default="ask",
        description="Only say what is found; wait for the operator's word; or act unasked.",
    )
    flow_factor: tuple[
        Annotated[float, Field(ge=0.3, le=1)], Annotated[float, Field(ge=1, le=3)]
    ] = Field(default=(0.6, 1.7), description="Bounds of the correction of the flow.")
    park_mm: tuple[float, float, float] | None = Field(
        default=None,
        description="Where the needle waits outside of the view, printer's frame; straight above "
        "by default.",
    )
    limit_s: Annotated[float, Field(ge=5, le=3600)] = Field(
        default=120.0, description="A look that takes longer pauses the print for the operator."
    )

    @model_validator(mode="after")
    def _real_device_has_a_frame(self) -> ObservePart:
        if self.source and self.frame is None:
            how = "`printctl observe frame`" if self.device == "camera" else "printer_to_scan"
            how += ", or `printctl observe sweep`" if self.device == "laser_line" else ""
            raise ValueError(
                f"device {self.device} with a source needs frame: the file by which what it sees "
                f"becomes millimetres of the printer ({how})"
            )
        return self

    def files(self) -> list[str]:
        """Names of the user's files that it is made from."""
        return [] if self.frame is None else [self.frame]
