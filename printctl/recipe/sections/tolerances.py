"""Recipe section or separate file of tolerances: diameters, features, limits by vessel."""

from __future__ import annotations

import math
import re
from typing import Annotated, Any

from pydantic import BeforeValidator, ConfigDict, Field, model_validator

from printctl.recipe.parts import Part
from registration.measuring.judging.tolerance import Limit, Override, Rule, Tolerances, VesselLimits

_NUMBER = r"(\d+(?:\.\d*)?|\.\d+)"
_PAIR = re.compile(rf"^\+{_NUMBER}\s*/\s*[-\u2212]{_NUMBER}$")
_MOST = 5000.0


def _sides(value: Any) -> tuple[float, float]:
    """Read minus and plus of ``10`` or ``+10/-5``."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value), float(value)
    match = _PAIR.match(value.strip()) if isinstance(value, str) else None
    if match is None:
        raise ValueError("give one number for both sides, like 10, or both sides, like +10/-5")
    return float(match[2]), float(match[1])


def _checked(value: Any) -> Any:
    # None is a key without a value, which `VesselTolerancePart` refuses.
    if value is None:
        return None
    minus, plus = _sides(value)
    if not (0 <= minus <= _MOST and 0 <= plus <= _MOST and max(minus, plus) > 0):
        raise ValueError(
            f"the sides are +{plus:g} and -{minus:g}; each must lie within 0 to {_MOST:g}, one "
            "above 0"
        )
    return value


Sides = Annotated[
    float | str,
    BeforeValidator(_checked),
    Field(description="Allowed deviation: one number for both sides, or like +10/-5."),
]
Positive = Annotated[float, Field(gt=0, le=5000)]


class VesselTolerancePart(Part):
    """Limits of diameters and features; what isn't given is as the design's.

    Numbers are numbers: neither ``true`` nor ``"10"`` is one.
    """

    model_config = ConfigDict(strict=True)

    diameter_percent: Sides | None = Field(default=None, description="Of every section.")
    diameter_um: Sides | None = Field(default=None, description="Of every section; tighter wins.")
    mean_percent: Sides | None = Field(default=None, description="Of a vessel's mean diameter.")
    mean_um: Sides | None = None
    narrowest_percent: Positive | None = Field(
        default=None, description="How much narrower than designed the narrowest section may be."
    )
    narrowest_um: Positive | None = None
    offset_um: Positive | None = Field(
        default=None, description="Of the lumen's mean distance from the designed axis."
    )
    leak_um: Annotated[float, Field(ge=0, le=5000)] | None = Field(
        default=None, description="Widest leak or bridge allowed; 0: none."
    )
    open: bool | None = Field(default=None, description="Whether it must be open.")
    position_um: Positive | None = Field(
        default=None, description="Position of the axis: diameter of the zone (ISO 1101)."
    )
    port_position_um: Positive | None = Field(
        default=None, description="Position of the vessel's mouths: diameter of the zone."
    )
    cylindricity_um: Positive | None = Field(
        default=None, description="Of straight vessels: radial width of the zone."
    )
    profile_um: Positive | None = Field(
        default=None, description="Profile of the lumen's surface: width of the zone."
    )

    @model_validator(mode="before")
    @classmethod
    def _check_values(cls, data: Any) -> Any:
        if isinstance(data, dict):
            for name, value in data.items():
                if value is None:
                    raise ValueError(f"{name} has no value; give one, or leave the key out")
        return data

    def changes(self) -> dict[str, Any]:
        """Fields of `VesselLimits` that are given."""
        given = {
            "diameter": _limit(self.diameter_percent, self.diameter_um),
            "mean": _limit(self.mean_percent, self.mean_um),
            "narrowest": _lower(self.narrowest_percent, self.narrowest_um),
            "offset_um": self.offset_um,
            "leak_um": self.leak_um,
            "open": self.open,
            "position_um": self.position_um,
            "port_position_um": self.port_position_um,
            "cylindricity_um": self.cylindricity_um,
            "profile_um": self.profile_um,
        }
        return {name: value for name, value in given.items() if value is not None}


class OverridePart(VesselTolerancePart):
    """Limits of some vessels."""

    vessels: list[Annotated[int, Field(ge=0)]] = Field(
        default=[], description="Numbers in network.csv."
    )
    kinds: list[str] = Field(default=[], description="Kinds, like artery.")

    @model_validator(mode="after")
    def _check_vessels(self) -> OverridePart:
        if bool(self.vessels) == bool(self.kinds):
            raise ValueError(
                f"names {'both vessels and kinds' if self.kinds else 'no vessel'}; give either "
                "vessels: [0, 1] or kinds: [artery]"
            )
        return self


class TolerancesPart(VesselTolerancePart):
    """What a print is held against."""

    rms_um: Positive | None = Field(default=None, description="RMS deviation of the scaled fit.")
    rigid_rms_um: Positive | None = Field(
        default=None, description="RMS deviation of the fit without scales; else rms_um."
    )
    size_percent: Positive = Field(
        default=2.0,
        description="By how much the print may be larger or smaller than designed along each axis.",
    )
    face_profile_um: Positive | None = Field(
        default=None, description="Profile of each outer face's surface: width of the zone."
    )
    vessels: list[OverridePart] = Field(
        default=[], description="Limits of some vessels; of two for one vessel the later counts."
    )

    def tolerances(self, rms_um: float, diameter_percent: float | str, rule: Rule) -> Tolerances:
        """Return the tolerances; the first two hold where the file gives no such limit."""
        default = {"diameter": _limit(diameter_percent, None), "rule": rule}
        return Tolerances(
            limits=VesselLimits(**(default | self.changes())),
            rms_um=rms_um if self.rms_um is None else self.rms_um,
            rigid_rms_um=self.rigid_rms_um,
            size_percent=self.size_percent,
            face_profile_um=math.inf if self.face_profile_um is None else self.face_profile_um,
            overrides=tuple(
                Override(frozenset(one.vessels), frozenset(one.kinds), one.changes())
                for one in self.vessels
            ),
        )


def _limit(percent: float | str | None, um: float | str | None) -> Limit | None:
    if percent is None and um is None:
        return None
    given: dict[str, float] = {}
    for unit, value in (("percent", percent), ("um", um)):
        if value is not None:
            given[f"minus_{unit}"], given[f"plus_{unit}"] = _sides(value)
    return Limit(**given)


def _lower(percent: float | None, um: float | None) -> Limit | None:
    """A limit below alone."""
    if percent is None and um is None:
        return None
    sides = {"minus_percent": percent, "minus_um": um}
    return Limit(**{name: value for name, value in sides.items() if value is not None})
