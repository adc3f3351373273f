"""How the inside of a FRESH part is filled, as a whole and in regions of it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from design.toolpath.fresh import DENSEST_GYROID, Infill
from printctl.recipe.parts import Length, Part
from printctl.recipe.tissue import MeshPart, ZonePart


class FillingPart(Part):
    """What is written inside the walls."""

    infill: Infill = "lines"
    infill_percent: Annotated[float, Field(ge=0, le=100)] = 100.0
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
    """A place that is filled in another way; of several that overlap the last counts."""

    where: ZonePart | None = Field(default=None, description="A shape or a mesh.")
    around_vessels_mm: Length | None = Field(
        default=None, description="Instead of `where`: all that is nearer to a lumen than this."
    )

    @model_validator(mode="after")
    def _is_somewhere(self) -> RegionPart:
        if (self.where is None) == (self.around_vessels_mm is None):
            raise ValueError("a region needs either where or around_vessels_mm; give one of them")
        return self

    def files(self) -> list[str]:
        """Names of the user's files that it is made from."""
        return [self.where.mesh] if isinstance(self.where, MeshPart) else []
