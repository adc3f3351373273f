"""Recipe section on an organ template; given landmarks replace those found in the shape."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from printctl.recipe.parts import Length, Part, Point

INLETS = {
    "heart": ("left_coronary", "right_coronary"),
    "kidney": ("hilum",),
    "liver": ("porta_hepatis", "vena_cava"),
    "cortex": ("pial_artery",),
}
"""Names of the inlets of each template."""
_OF = {
    "base_direction": ("heart",),
    "right_direction": ("heart",),
    "trunk_depth_mm": ("heart", "cortex"),
    "vein": ("kidney",),
    "cortex_mm": ("kidney", "cortex"),
    "cortex_demand": ("kidney",),
    "pial_direction": ("cortex",),
    "arterioles_per_mm2": ("cortex",),
}
_DIRECTIONS = ("base_direction", "right_direction", "pial_direction")


class InletPart(Part):
    """Where a tree enters; the nearest place that suits is taken."""

    at_mm: Point


class AnatomyPart(Part):
    """An organ's template; each place is found in the shape unless it is given."""

    template: Literal["heart", "kidney", "liver", "cortex"]
    inlets: dict[str, InletPart] = Field(
        default={},
        description="Heart: left_coronary, right_coronary; kidney: hilum; liver: porta_hepatis, "
        "vena_cava; cortex: pial_artery.",
    )
    base_direction: Point | None = Field(default=None, description="Heart: from apex to base.")
    right_direction: Point | None = Field(
        default=None, description="Heart: from the left ventricle to the right one."
    )
    trunk_ends: Annotated[int, Field(ge=6, le=2000)] | None = Field(
        default=None,
        description="Ends of the trunks, at about; heart: 600, kidney: 120, liver: 100, "
        "cortex: 200 at most.",
    )
    trunk_depth_mm: Length | None = Field(
        default=None,
        description="Least depth of the trunks' axes; heart: 0.3 by default, cortex: 0.2.",
    )
    vein: Literal["none", "beside"] | None = Field(
        default=None, description="Kidney: beside the artery, along all of it; none by default."
    )
    cortex_mm: Length | None = Field(
        default=None,
        description="Thickness of the cortex; kidney: a third of the depth by default; brain: as "
        "found.",
    )
    cortex_demand: Annotated[float, Field(gt=0, le=1000)] | None = Field(
        default=None, description="Kidney: flow of the cortex per volume over the medulla's."
    )

    pial_direction: Point | None = Field(
        default=None, description="Cortex: out of the pial side; the larger side by default."
    )
    arterioles_per_mm2: Annotated[float, Field(gt=0, le=100)] | None = Field(
        default=None, description="Cortex: of its pial side; 1 by default."
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
        known = INLETS[self.template]
        for name in self.inlets:
            if name not in known:
                raise ValueError(
                    f"inlet {name} isn't one of a {self.template}'s; name it {' or '.join(known)}"
                )
        for key, templates in _OF.items():
            if getattr(self, key) is not None and self.template not in templates:
                raise ValueError(f"{key} isn't for a {self.template}; remove it")
        for key in _DIRECTIONS:
            if getattr(self, key) is not None and not any(getattr(self, key)):
                raise ValueError(f"{key} is (0, 0, 0); give a direction")
        return self
