"""REST of the printer: models of what is asked and answered, and routes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Request
from pydantic import BaseModel, ConfigDict, Field

from firmware_profiles import Bath, Dish, Facts, Ink, Needle, Printer, Syringe
from printctl.machine.station import StationStatus
from printctl.web.controls import Principal
from printctl.web.printer.calibration_requests import CalibrationFiles, CalibrationRequest, Read
from printctl.web.printer.console import Macro
from printctl.web.printer.part_change import Surface, Touching
from printctl.web.printer.ports import summary
from printctl.web.printer.service import PrinterService

# Request and response types of the Printer page's REST routes.

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


# REST routes for calibrations: list, write a test, fit readings, save a measured profile.


def add_calibration(
    routes: APIRouter, service: PrinterService, who: Callable[[Request], Principal]
) -> None:
    """Add them."""
    calibrating = service.calibrating

    @routes.get("/calibrations", summary="Calibrations, and what each needs")
    def listed() -> list[dict[str, Any]]:
        return [asdict(wizard) for wizard in calibrating.wizards]

    @routes.post("/calibrations/{name}/job", summary="Write a test into the workspace's jobs")
    def make(name: str, body: CalibrationRequest, request: Request) -> CalibrationFiles:
        return calibrating.make(who(request), name, body)

    @routes.post("/calibrations/{name}/fit", summary="What readings say")
    def fit(name: str, body: Read) -> FittedConstants:
        result = calibrating.fit(name, body)
        estimates = {key: asdict(one) for key, one in result.lines.items()}
        return FittedConstants(estimates=estimates, notes=result.notes)

    @routes.post("/calibrations/weigh/profile", summary="Write a measured copy of a profile")
    def save(body: Save, request: Request) -> ActionResult:
        message = calibrating.save(who(request), body.read, body.mend, body.copy_name)
        return ActionResult(message=message)


# REST routes of console, macros, touch-off, and syringe or needle changes.

Who = Callable[[Request], Principal]


def add_tools(routes: APIRouter, service: PrinterService, who: Who) -> None:
    """Add them."""
    _add_console(routes, service, who)
    _add_macros(routes, service, who)
    _add_touching(routes, service, who)
    _add_changes(routes, service, who)


def _add_console(routes: APIRouter, service: PrinterService, who: Who) -> None:
    @routes.post("/command", summary="Send a line by the console")
    def command(body: ConsoleLine, request: Request) -> Replies:
        return Replies(replies=service.console.send(who(request), body.text))

    @routes.get("/console", summary="What was typed, answered and refused")
    def console(after: int = 0) -> list[dict[str, Any]]:
        return [entry.to_dict() for entry in service.console.entries(after)]


def _add_macros(routes: APIRouter, service: PrinterService, who: Who) -> None:
    macros = service.macros

    @routes.get("/macros/{profile}", summary="Macros of a profile")
    def listed(profile: str) -> MacroList:
        return MacroList(macros=macros.of(profile))

    @routes.put("/macros/{profile}", summary="Keep a macro, in place of one of its name")
    def save(profile: str, body: Macro, request: Request) -> MacroList:
        macros.save(who(request), profile, body)
        return MacroList(macros=macros.of(profile))

    @routes.delete("/macros/{profile}/{name}", summary="Remove a macro")
    def remove(profile: str, name: str, request: Request) -> MacroList:
        macros.remove(who(request), profile, name)
        return MacroList(macros=macros.of(profile))

    @routes.post("/macros/run/{name}", summary="Run a macro of the printer connected")
    def run(name: str, request: Request) -> Replies:
        return Replies(replies=macros.run(who(request), name))


def _add_touching(routes: APIRouter, service: PrinterService, who: Who) -> None:
    guide = service.guide

    def told(touching: Touching | None) -> TouchingState:
        return TouchingState(touching=None if touching is None else touching.to_dict())

    @routes.get("/touch-off", summary="What was read of floor or bath so far")
    def state() -> TouchingState:
        return told(guide.touching)

    @routes.post("/touch-off", summary="Begin to touch off the floor or the bath's surface")
    def start(body: StartTouching, request: Request) -> TouchingState:
        return told(guide.start(who(request), body.surface, body.foil_mm))

    @routes.post("/touch-off/reading", summary="Take the tip's height as a reading")
    def read(request: Request) -> TouchingState:
        return told(guide.read(who(request)))

    @routes.post("/touch-off/use", summary="Use the height that three readings agree on")
    def use(request: Request) -> Status:
        return _status(guide.use(who(request)))

    @routes.delete("/touch-off", summary="Forget the readings")
    def give_up(request: Request) -> TouchingState:
        guide.give_up(who(request))
        return told(guide.touching)


def _add_changes(routes: APIRouter, service: PrinterService, who: Who) -> None:
    changing = service.changing

    @routes.post("/change/syringe", summary="Say that a syringe was put in, and how full")
    def syringe(body: NewSyringe, request: Request) -> Status:
        return _status(changing.syringe(who(request), body.syringe, body.ink, body.filled_ul))

    @routes.post("/change/purge", summary="Push bubbles out, a little at a time")
    def purge(body: Push, request: Request) -> Status:
        return _status(changing.purge(who(request), body.ul, body.ul_s))

    @routes.post("/change/needle", summary="Say that a needle was put in; touch off follows")
    def needle(body: NewNeedle, request: Request) -> Status:
        return _status(changing.needle(who(request), body.needle))


def _status(status: StationStatus) -> Status:
    return Status(**status.to_dict(), needs_touch_off=status.mounted.touch_off_due)


REFUSALS: dict[int | str, dict[str, Any]] = {
    403: {"description": "Not allowed"},
    404: {"description": "No such profile or macro"},
    409: {"description": "Not while things stand as they do, or refused by the station"},
    422: {"description": "Can't be taken as it was sent"},
    423: {"description": "Another browser holds the controls"},
}
_SORTS: dict[str, type[Facts]] = {
    "needle": Needle,
    "syringe": Syringe,
    "ink": Ink,
    "dish": Dish,
    "bath": Bath,
}


def requesting_user(request: Request) -> Principal:
    """Return the requesting user, as set by the access guard."""
    principal = getattr(request.state, "principal", None)
    return principal if isinstance(principal, Principal) else Principal("local", "this machine")


def status_of(status: StationStatus) -> Status:
    """A status as it is given."""
    return Status(**status.to_dict(), needs_touch_off=status.mounted.touch_off_due)


def router(service: PrinterService) -> APIRouter:
    """Routes under ``/api/v1/printer``."""
    routes = APIRouter(prefix="/api/v1/printer", tags=["printer"], responses=REFUSALS)
    _add_connection(routes, service)
    _add_hands(routes, service)
    add_tools(routes, service, requesting_user)
    add_calibration(routes, service, requesting_user)
    return routes


def _add_connection(routes: APIRouter, service: PrinterService) -> None:
    @routes.get("/status", summary="The printer as it was heard of last")
    def status() -> Status:
        return status_of(service.status)

    @routes.get("/ports", summary="Serial ports, and whose USB id each has; opens none")
    def ports() -> list[Port]:
        return [Port(**vars(port)) for port in service.ports()]

    @routes.get("/profiles", summary="Printer profiles that can be connected")
    def profiles() -> list[Profile]:
        ports = []
        for name in service.store.printers():
            printer = service.store.load(Printer, name)
            one = Profile(
                name=name, summary=summary(printer), starting_values=printer.starting_values
            )
            ports.append(one)
        return ports

    @routes.post("/connect", summary="Connect a printer")
    def connect(body: ConnectTo, request: Request) -> Status:
        return status_of(
            service.connect(requesting_user(request), body.profile, body.port, body.baud)
        )

    @routes.post("/disconnect", summary="Let go of the port; heaters go off")
    def disconnect(request: Request) -> Status:
        return status_of(service.disconnect(requesting_user(request)))

    @routes.post("/reconnect", summary="Open the port again after a halt or a lost port")
    def reconnect(request: Request) -> Status:
        return status_of(service.reconnect(requesting_user(request)))

    @routes.get("/temperatures", summary="The last ten minutes, by columns")
    def temperatures() -> dict[str, Any]:
        return service.plots.columns()


def _add_hands(routes: APIRouter, service: PrinterService) -> None:
    hands = service.hands

    @routes.post("/jog", summary="Move the tip by a step")
    def jog(body: Jog, request: Request) -> Status:
        return status_of(hands.jog(requesting_user(request), body.axis, body.mm, body.speed_mm_s))

    @routes.post("/lift-out", summary="Move the tip straight up, out of the bath")
    def lift_out(request: Request) -> Status:
        return status_of(hands.lift_out(requesting_user(request)))

    @routes.post("/home", summary="Home axes")
    def home(body: Home, request: Request) -> Status:
        return status_of(
            hands.home(requesting_user(request), body.axes, needle_off=body.needle_off)
        )

    @routes.post("/set-position", summary="Say where the tip stands; nothing moves")
    def set_position(body: Place, request: Request) -> Status:
        return status_of(hands.set_position(requesting_user(request), body.x, body.y, body.z))

    @routes.post("/stop-motion", summary="Stop a move by hand; needs no controls")
    def stop_motion() -> Status:
        return status_of(service.stop_motion())

    @routes.post("/heat", summary="Set a heater's target")
    def heat(body: Heat, request: Request) -> Status:
        return status_of(hands.heat(requesting_user(request), body.name, body.celsius))

    @routes.post("/heaters-off", summary="Set every target to 0")
    def heaters_off(request: Request) -> Status:
        return status_of(hands.heaters_off(requesting_user(request)))

    @routes.post("/plunger", summary="Push or draw back ink")
    def plunger(body: Push, request: Request) -> Status:
        return status_of(hands.plunger(requesting_user(request), body.ul, body.ul_s))

    @routes.post("/mount", summary="Say what is mounted")
    def mount(body: MountRequest, request: Request) -> Status:
        parts = body.model_dump(exclude_unset=True)
        for key, model in _SORTS.items():
            if parts.get(key):
                parts[key] = service.store.given(model, parts[key])
        return status_of(hands.mount(requesting_user(request), **parts))
