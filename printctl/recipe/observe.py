"""Recipe section on observing a print: device, marks to look at, tolerances, what may be mended."""

from __future__ import annotations

import re
from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field, model_validator

from printctl.recipe.marks import FILE
from printctl.recipe.parts import Part, Point

_EVERY: Final = re.compile(r"(layer|vessel)|(\d+(?:\.\d+)?) *(mm|min|s)")

DeviceName = Literal["camera", "oct", "laser_line", "folder", "command", "simulated"]


def _known_interval(text: str) -> str:
    if not _EVERY.fullmatch(text):
        raise ValueError(
            f"{text!r} isn't a place to look at: say layer, vessel, or a way or time between looks "
            "such as 800 mm (of written lines), 10 min or 30 s"
        )
    return text


class ObserveTolerances(Part):
    """Deviations that are let pass."""

    gap_mm: Annotated[float, Field(ge=0.02, le=20)] = Field(
        default=0.2, description="Shorter stretches without ink."
    )
    width_percent: Annotated[float, Field(ge=1, le=100)] = Field(
        default=15.0, description="Of a single line's width."
    )
    lumen_percent: Annotated[float, Field(ge=1, le=100)] = Field(
        default=10.0, description="By which a lumen may be seen narrower."
    )
    shift_mm: Annotated[float, Field(ge=0.01, le=5)] = Field(
        default=0.1, description="By which a layer may lie beside its place."
    )


class ObservePart(Part):
    """How the print is looked at while it is made."""

    device: DeviceName
    source: str = Field(
        default="",
        description="Of a camera its number or address; of a folder its path; of a command its "
        "words, {out} for the file that it writes.",
    )
    lens: str | None = Field(
        default=None, description="File of `printctl calibrate camera`.", json_schema_extra=FILE
    )
    frame: str | None = Field(
        default=None, description="File of `printctl observe frame`.", json_schema_extra=FILE
    )
    every: Annotated[str, AfterValidator(_known_interval)] = Field(
        default="layer",
        description="Where a layer or vessel ends; or at the first such mark after so much: "
        "800 mm (of written lines), 10 min, 30 s.",
    )
    tolerance: ObserveTolerances = ObserveTolerances()
    mend: Literal["tell", "ask", "mend"] = Field(
        default="ask",
        description="Only say what is found; wait for the operator's word; or act unasked.",
    )
    flow_factor: tuple[
        Annotated[float, Field(ge=0.3, le=1)], Annotated[float, Field(ge=1, le=3)]
    ] = Field(default=(0.6, 1.7), description="Bounds of the correction of the flow.")
    park_mm: Point | None = Field(
        default=None,
        description="Where the needle waits outside of the view, printer's frame; straight above "
        "by default.",
    )
    limit_s: Annotated[float, Field(ge=5, le=3600)] = Field(
        default=120.0, description="A look that takes longer pauses the print for the operator."
    )

    @model_validator(mode="after")
    def _device_has_a_source(self) -> ObservePart:
        if self.device in ("folder", "command", "oct", "laser_line") and not self.source:
            what = "a path" if self.device == "folder" else "a command or a folder's path"
            raise ValueError(f"device {self.device} needs source: {what}")
        return self

    @model_validator(mode="after")
    def _camera_has_a_frame(self) -> ObservePart:
        if self.device in ("camera", "folder", "command") and self.frame is None:
            raise ValueError(
                f"device {self.device} needs frame: the file by which pixels become millimetres "
                "(`printctl observe frame`)"
            )
        return self

    def files(self) -> list[str]:
        """Names of the user's files that it is made from."""
        return [name for name in (self.lens, self.frame) if name is not None]
