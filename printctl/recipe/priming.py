"""Recipe section on priming: the needle's moves before the part."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from printctl.recipe.parts import Part

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
