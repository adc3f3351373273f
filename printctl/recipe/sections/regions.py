"""Recipe section on infill of a FRESH part, as a whole and by region."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from design.toolpath.fresh import DENSEST_GYROID, Infill
from printctl.recipe.parts import Length, Part
from printctl.recipe.sections.tissue import MeshPart, ZonePart


class FillingPart(Part):
    """What is written inside the walls."""

    infill: Infill = Field(default="lines", description="What fills the inside of the walls.")
    infill_percent: Annotated[float, Field(ge=0, le=100)] = Field(
        default=100.0, description="Share of the inside that is filled."
    )
    infill_angles_deg: Annotated[
        tuple[Annotated[float, Field(ge=-360, le=360)], ...], Field(min_length=1, max_length=32)
    ] = Field(default=(0.0, 90.0), description="Of the infill's lines, layer after layer in turn.")

    @model_validator(mode="after")
    def _a_gyroid_has_room(self) -> FillingPart:
        most = 100 * DENSEST_GYROID
        if self.infill == "gyroid" and self.infill_percent > most:
            raise ValueError(
                f"a gyroid's lines meet above {most:g} %; lower infill_percent (it is "
                f"{self.infill_percent:g}) or choose infill: lines"
            )
        return self


class RegionPart(FillingPart):
    """A place that is filled in another way or ink; of several that overlap the last counts."""

    where: ZonePart | None = Field(default=None, description="A shape or a mesh.")
    around_vessels_mm: Length | None = Field(
        default=None, description="Instead of `where`: all that is nearer to a lumen than this."
    )

    head: Annotated[int, Field(ge=0)] | None = Field(
        default=None, description="Of several, the one that writes it, with walls of its own."
    )
    line_um: Annotated[float, Field(ge=20, le=5000)] | None = Field(
        default=None, description="Width of that head's lines; toolpath.line_um where not given."
    )

    @model_validator(mode="after")
    def _lines_are_a_head_s(self) -> RegionPart:
        if self.line_um is not None and self.head is None:
            raise ValueError(
                f"line_um is {self.line_um:g}, and no head is named that writes such lines; name "
                "it (head), or leave line_um out"
            )
        return self

    @model_validator(mode="after")
    def _is_somewhere(self) -> RegionPart:
        if (self.where is None) == (self.around_vessels_mm is None):
            raise ValueError("a region needs either where or around_vessels_mm; give one of them")
        return self

    def files(self) -> list[str]:
        """Names of the user's files that it is made from."""
        return [self.where.mesh] if isinstance(self.where, MeshPart) else []
