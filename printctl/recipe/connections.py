"""Recipe section on vessels that connect terminals of trees: bounds and cost of their curves."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from printctl.recipe.parts import Part

_Weight = Annotated[float, Field(ge=0, le=1000)]


class ConnectionPart(Part):
    """Bounds of the curves between terminals, and what a candidate is weighed by."""

    bend_to_radius: Annotated[float, Field(ge=1, le=100)] = Field(
        default=2.0, description="Least bend radius over the lumen's radius."
    )
    kink_degrees: Annotated[float, Field(ge=1, le=85)] = Field(
        default=75.0, description="Largest angle between a terminal and its connection."
    )
    radius_ratio: Annotated[float, Field(ge=0.1, le=10)] = Field(
        default=0.75,
        description="Of a typical connection over the median terminal's; the smallest diameter "
        "goes before.",
    )
    most_pruned_percent: Annotated[float, Field(ge=0, le=50)] = Field(
        default=1.0, description="Terminals that may be taken away where nothing joins them."
    )
    length_weight: _Weight = 1.0
    tortuosity_weight: _Weight = 0.5
    clearance_weight: _Weight = 0.5
    volume_weight: _Weight = 0.5
