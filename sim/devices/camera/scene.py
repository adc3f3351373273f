"""Settings of a simulated picture besides the ink: bath, light, sensor.

Grey levels are 0 to 255, of linear light before the sensor's gamma; colours are red, green, blue.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

from firmware_profiles.strict_model import BeadShape

Grey = Annotated[float, Field(ge=0, le=255)]
Colour = tuple[Grey, Grey, Grey]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-360, le=360)]


class SceneFacts(BaseModel):
    """Base of all sections."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Bath(SceneFacts):
    """Support bath.

    Attributes
    ----------
    surface_z_mm : float, mm, or None
        Of the bath, printer's frame; None for none (what is seen lies in air).
    turbidity_per_mm : float
        Attenuation of the light, once each way.
    texture : float
        Standard deviation of the granules' brightness, of 1.
    granule_mm : float, mm
        Size of the finest; coarser ones lie among them.
    """

    colour: Colour = (172, 168, 158)
    surface_z_mm: float | None = None
    refractive_index: Annotated[float, Field(ge=1, le=2)] = 1.33
    turbidity_per_mm: NonNegative = 0.35
    texture: Annotated[float, Field(ge=0, le=0.5)] = 0.04
    granule_mm: Annotated[float, Field(ge=0.005, le=2)] = 0.06


class InkLook(SceneFacts):
    """Ink.

    Attributes
    ----------
    colour
        Of ink so thick that nothing shines through.
    density_per_mm : float
        How fast it comes to that (1/e).
    edge : float
        Darkening of its rims by refraction, of 1; below 0 brightening.
    relief : float
        How much ridges are lit and shaded, of 1.
    bead : shape or float
        Section of lines in a layer, as an ink's profile says it (`firmware_profiles.bead`).
    """

    colour: Colour = (225, 222, 214)
    density_per_mm: Positive = 9.0
    edge: Annotated[float, Field(ge=-1, le=1)] = 0.15
    relief: Annotated[float, Field(ge=0, le=2)] = 0.25
    bead: BeadShape | Annotated[float, Field(ge=-1000, le=1000)] = "rounded"


class Light(SceneFacts):
    """Light from one side.

    Attributes
    ----------
    azimuth_deg : float, degrees
        Where it comes from (0 is +x, 90 is +y).
    uneven : float
        Fall across the field, of 1.
    """

    azimuth_deg: Angle = 135.0
    uneven: Annotated[float, Field(ge=0, le=0.9)] = 0.15


class Sensor(SceneFacts):
    """Lens faults and sensor.

    Attributes
    ----------
    blur_px : float
        Standard deviation of the point spread.
    vignetting : float
        Fall of the light to the farthest corner, of 1.
    full_well : float, electrons
        At level 255; shot noise is its root.
    read_noise : float, grey levels
    gamma : float
        2.2 for a picture made to be looked at; 1 for linear.
    mono : bool
        Grey, (h, w).
    """

    blur_px: Annotated[float, Field(ge=0, le=50)] = 0.8
    vignetting: Annotated[float, Field(ge=0, le=0.95)] = 0.1
    full_well: Annotated[float, Field(ge=100, le=1e6)] = 10_000.0
    read_noise: Annotated[float, Field(ge=0, le=50)] = 0.8
    gamma: Annotated[float, Field(ge=0.3, le=3)] = 1.0
    mono: bool = False


class Scene(SceneFacts):
    """All that a picture shows besides the ink; `seed` is of what lies there from look to look."""

    bath: Bath = Bath()
    ink: InkLook = InkLook()
    light: Light = Light()
    sensor: Sensor = Sensor()
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0

    def shades(self, colour: Colour) -> tuple[float, ...]:
        """A colour as the sensor tells it: red, green, blue, or grey (BT.601) alone."""
        if not self.sensor.mono:
            return colour
        red, green, blue = colour
        return (0.299 * red + 0.587 * green + 0.114 * blue,)

    @model_validator(mode="after")
    def _ink_shows(self) -> Scene:
        if self.ink.colour == self.bath.colour:
            raise ValueError("ink.colour is the bath's; nothing would be seen of the ink")
        return self
