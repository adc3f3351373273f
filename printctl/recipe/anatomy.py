"""Recipe section on anatomy: a template, and what its user says instead of its findings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from printctl.recipe.parts import Length, Part, Point

_INLETS = {
    "heart": ("left_coronary", "right_coronary"),
    "kidney": ("hilum",),
}
_OF_HEART = ("base_direction", "right_direction")
_OF_KIDNEY = ("vein", "cortex_mm", "cortex_demand")


class InletPart(Part):
    """Where a tree enters; the nearest place that suits is taken."""

    at_mm: Point


class AnatomyPart(Part):
    """An organ's template; each place is found in the shape unless it is given."""

    template: Literal["heart", "kidney"]
    inlets: dict[str, InletPart] = Field(
        default={}, description="Heart: left_coronary, right_coronary; kidney: hilum."
    )
    base_direction: Point | None = Field(default=None, description="Heart: from apex to base.")
    right_direction: Point | None = Field(
        default=None, description="Heart: from the left ventricle to the right one."
    )
    trunk_ends: Annotated[int, Field(ge=6, le=2000)] | None = Field(
        default=None, description="Ends of the trunks, at about; 600 in a heart, 120 in a kidney."
    )
    trunk_depth_mm: Length | None = Field(
        default=None, description="Heart: least depth of the trunks' axes; 0.3 by default."
    )
    vein: Literal["none", "beside"] | None = Field(
        default=None, description="Kidney: beside the artery, along all of it; none by default."
    )
    cortex_mm: Length | None = Field(
        default=None,
        description="Kidney: thickness of the cortex; a third of the depth by default.",
    )
    cortex_demand: Annotated[float, Field(gt=0, le=1000)] | None = Field(
        default=None, description="Kidney: flow of the cortex per volume over the medulla's."
    )

    @field_validator("inlets", mode="before")
    @classmethod
    def _inlets_are_places(cls, given: Any) -> Any:
        like = "{at_mm: [x, y, z]}, in mm"
        if not isinstance(given, Mapping):
            raise ValueError(
                f"an organ's inlets have names; write {{name: {like[:-7]}}}, or leave the key "
                "away, and they are found in the shape"
            )
        for name, place in given.items():
            at = place.get("at_mm") if isinstance(place, Mapping) else place
            at = place.at_mm if isinstance(place, InletPart) else at
            if not isinstance(place, Mapping | InletPart) or not (
                isinstance(at, list | tuple) and len(at) == 3
            ):
                raise ValueError(f"inlet {name} is {place}; write {name}: {like}")
        return given

    @model_validator(mode="after")
    def _keys_fit(self) -> AnatomyPart:
        known = _INLETS[self.template]
        for name in self.inlets:
            if name not in known:
                raise ValueError(
                    f"inlet {name} isn't one of a {self.template}'s; name it {' or '.join(known)}"
                )
        others = _OF_KIDNEY if self.template == "heart" else (*_OF_HEART, "trunk_depth_mm")
        for key in others:
            if getattr(self, key) is not None:
                raise ValueError(f"{key} isn't for a {self.template}; remove it")
        for key in _OF_HEART:
            if getattr(self, key) is not None and not any(getattr(self, key)):
                raise ValueError(f"{key} is (0, 0, 0); give a direction")
        return self
