"""Request and response types of the Printer page's REST routes."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from printctl.web.printer.calibration_requests import Read
from printctl.web.printer.macros import Macro
from printctl.web.printer.touch_off import Surface

Name = Annotated[str, Field(min_length=1, max_length=64)]
MM = Annotated[float, Field(ge=-1000, le=1000, allow_inf_nan=False)]


class _Body(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class ConnectTo(_Body):
    """Which printer, and where."""

    profile: Name
    port: Annotated[str, Field(min_length=1, max_length=200)] = "auto"
    baud: Annotated[int, Field(ge=300, le=4_000_000)] | Literal["auto"] | None = None


class Jog(_Body):
    """A step along an axis, mm."""

    axis: Literal["x", "y", "z"]
    mm: MM
    speed_mm_s: Annotated[float, Field(gt=0, le=1000)] | None = None


class Home(_Body):
    """Axes to home; ``needle_off`` says that no needle is mounted."""

    axes: Annotated[tuple[Literal["x", "y", "z"], ...], Field(min_length=1, max_length=3)]
    needle_off: bool = False


class Place(_Body):
    """Where the tip stands, mm, printer's frame; axes left out stay as they are."""

    x: MM | None = None
    y: MM | None = None
    z: MM | None = None


class Heat(_Body):
    """A heater's target, °C; 0 is off."""

    name: Name
    celsius: Annotated[float, Field(ge=0, le=300)]


class Push(_Body):
    """Ink to push (above 0) or draw back, µL, and how fast, µL/s."""

    ul: Annotated[float, Field(ge=-100_000, le=100_000)]
    ul_s: Annotated[float, Field(gt=0, le=10_000)] | None = None


class ConsoleLine(_Body):
    """A line for the console."""

    text: Annotated[str, Field(min_length=1, max_length=200)]


class MountRequest(_Body):
    """What is mounted; keys left out stay as they are, an empty one takes away."""

    needle: Annotated[str, Field(max_length=64)] | None = None
    syringe: Annotated[str, Field(max_length=64)] | None = None
    ink: Annotated[str, Field(max_length=64)] | None = None
    dish: Annotated[str, Field(max_length=64)] | None = None
    bath: Annotated[str, Field(max_length=64)] | None = None
    dish_centre_mm: tuple[MM, MM] | None = None
    bath_level_mm: MM | None = None


class StartTouching(_Body):
    """Which surface, and the foil's thickness, mm."""

    surface: Surface
    foil_mm: Annotated[float, Field(ge=0, le=2)] = 0.0


class NewSyringe(_Body):
    """A syringe that was put in, with so much ink, µL."""

    syringe: Name
    ink: Annotated[str, Field(max_length=64)] = ""
    filled_ul: Annotated[float, Field(gt=0, le=100_000)]


class NewNeedle(_Body):
    """A needle that was put in."""

    needle: Name


class Save(_Body):
    """A measured copy of a profile: what of, and its name."""

    read: Read
    mend: Literal["printer", "syringe"]
    copy_name: Name


class Port(BaseModel):
    """A serial port, and the profiles whose USB id it has."""

    device: str
    description: str
    usb_id: str
    serial_number: str
    profiles: tuple[str, ...]


class Profile(BaseModel):
    """A printer profile."""

    name: str
    summary: str
    starting_values: tuple[str, ...]


class Status(BaseModel):
    """A station's status; see ``docs/station.md``."""

    model_config = ConfigDict(extra="allow")

    state: str
    message: str = ""
    profile: str = ""
    port: str = ""
    position_mm: tuple[float, float, float] | None = None
    position_trusted: bool = False
    needs_touch_off: bool = False


class Replies(BaseModel):
    """What the printer said."""

    replies: list[str]


class MacroList(BaseModel):
    """Macros of a profile."""

    macros: list[Macro]


class TouchingState(BaseModel):
    """What was read of a surface; null when nothing is being touched off."""

    touching: dict[str, Any] | None


class FittedConstants(BaseModel):
    """What readings say, 95 % intervals."""

    estimates: dict[str, dict[str, Any]]
    notes: tuple[str, ...]


class ActionResult(BaseModel):
    """What was done, in words."""

    message: str
