"""REST of the printer: what is sent, and routes."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any, Literal

from fastapi import APIRouter
from pydantic import Field

from printctl.web.printer.calibrations import (
    CalibrationFiles,
    CalibrationRequest,
    Mend,
    Read,
    Wizard,
)
from printctl.web.printer.choices import PARTS, FoundPort, PartChoice, PrinterChoice
from printctl.web.printer.console import Entry, Macro
from printctl.web.printer.part_change import THICKEST_FOIL_MM, Surface, Touching
from printctl.web.printer.service import PrinterService
from printctl.web.printer.status import PrinterStatus
from printctl.web.rest import API, REFUSALS, Asking, Body

Name = Annotated[str, Field(min_length=1, max_length=64)]
NameOrNone = Annotated[str, Field(max_length=64)]
MM = Annotated[float, Field(ge=-1000, le=1000)]


# --- what is sent ---------------------------------------------------------------------------------


class ConnectTo(Body):
    """Which printer, and where."""

    profile: Name
    port: Annotated[str, Field(min_length=1, max_length=200)] = "auto"
    baud: Annotated[int, Field(ge=300, le=4_000_000)] | Literal["auto"] | None = None


class Jog(Body):
    """A step along an axis, mm."""

    axis: Literal["x", "y", "z"]
    mm: MM
    speed_mm_s: Annotated[float, Field(gt=0, le=1000)] | None = None


class Home(Body):
    """Axes to home; ``needle_off`` says that no needle is mounted."""

    axes: Annotated[tuple[Literal["x", "y", "z"], ...], Field(min_length=1, max_length=3)]
    needle_off: bool = False


class Place(Body):
    """Where the tip stands, mm, printer's frame; axes left out stay as they are."""

    x: MM | None = None
    y: MM | None = None
    z: MM | None = None


class Heat(Body):
    """A heater's target, °C; 0 is off."""

    name: Name
    celsius: Annotated[float, Field(ge=0, le=300)]


class Push(Body):
    """Ink to push (above 0) or draw back, µL, and how fast, µL/s."""

    ul: Annotated[float, Field(ge=-100_000, le=100_000)]
    ul_s: Annotated[float, Field(gt=0, le=10_000)] | None = None


class ConsoleLine(Body):
    """A line for the console."""

    text: Annotated[str, Field(min_length=1, max_length=200)]


class MountRequest(Body):
    """What is mounted; keys left out stay as they are, an empty one takes away."""

    needle: NameOrNone | None = None
    syringe: NameOrNone | None = None
    ink: NameOrNone | None = None
    dish: NameOrNone | None = None
    bath: NameOrNone | None = None
    dish_centre_mm: tuple[MM, MM] | None = None
    bath_level_mm: MM | None = None


class StartTouching(Body):
    """Which surface, and the foil's thickness, mm."""

    surface: Surface
    foil_mm: Annotated[float, Field(ge=0, le=THICKEST_FOIL_MM)] = 0.0


class NewSyringe(Body):
    """A syringe that was put in, with so much ink, µL."""

    syringe: Name
    ink: NameOrNone = ""
    filled_ul: Annotated[float, Field(gt=0, le=100_000)]


class NewNeedle(Body):
    """A needle that was put in."""

    needle: Name


class Save(Body):
    """A measured copy of a profile: what of, and its name."""

    read: Read
    mend: Mend
    copy_name: Name


# --- routes ---------------------------------------------------------------------------------------


def router(service: PrinterService) -> APIRouter:
    """Routes under ``/api/v1/printer``."""
    routes = APIRouter(prefix=f"{API}/printer", tags=["printer"], responses=REFUSALS)
    for add in (
        _add_connection,
        _add_moves,
        _add_console,
        _add_macros,
        _add_touching,
        _add_changes,
        _add_calibrations,
    ):
        add(routes, service)
    return routes


def _add_connection(routes: APIRouter, service: PrinterService) -> None:
    @routes.get("/status", summary="Last known status of the printer")
    def status() -> PrinterStatus:
        return service.status

    @routes.get("/ports", summary="Serial ports, and whose USB id each has; opens none")
    def ports() -> list[FoundPort]:
        return service.ports()

    @routes.get("/profiles", summary="Printer profiles that can be connected")
    def profiles() -> list[PrinterChoice]:
        return service.printers()

    @routes.get("/parts", summary="Needles, syringes, inks, dishes and baths to choose from")
    def parts() -> dict[str, list[PartChoice]]:
        return service.parts()

    @routes.post("/connect", summary="Connect a printer")
    def connect(body: ConnectTo, who: Asking) -> PrinterStatus:
        return service.connect(who, **dict(body))

    @routes.post("/disconnect", summary="Let go of the port; heaters go off")
    def disconnect(who: Asking) -> PrinterStatus:
        return service.disconnect(who)

    @routes.post("/reconnect", summary="Open the port again after a halt or a lost port")
    def reconnect(who: Asking) -> PrinterStatus:
        return service.reconnect(who)

    @routes.get("/temperatures", summary="The last ten minutes, by columns")
    def temperatures() -> dict[str, Any]:
        return service.plots.columns()


def _add_moves(routes: APIRouter, service: PrinterService) -> None:
    commands = service.commands

    @routes.post("/jog", summary="Move the tip by a step")
    def jog(body: Jog, who: Asking) -> PrinterStatus:
        return commands.jog(who, **dict(body))

    @routes.post("/lift-out", summary="Move the tip straight up, out of the bath")
    def lift_out(who: Asking) -> PrinterStatus:
        return commands.lift_out(who)

    @routes.post("/home", summary="Home axes")
    def home(body: Home, who: Asking) -> PrinterStatus:
        return commands.home(who, **dict(body))

    @routes.post("/set-position", summary="Say where the tip stands; nothing moves")
    def set_position(body: Place, who: Asking) -> PrinterStatus:
        return commands.set_position(who, **dict(body))

    @routes.post("/stop-motion", summary="Stop a move by hand; needs no controls")
    def stop_motion() -> PrinterStatus:
        return service.stop_motion()

    @routes.post("/heat", summary="Set a heater's target")
    def heat(body: Heat, who: Asking) -> PrinterStatus:
        return commands.heat(who, **dict(body))

    @routes.post("/heaters-off", summary="Set every target to 0")
    def heaters_off(who: Asking) -> PrinterStatus:
        return commands.heaters_off(who)

    @routes.post("/plunger", summary="Push or draw back ink")
    def plunger(body: Push, who: Asking) -> PrinterStatus:
        return commands.plunger(who, **dict(body))

    @routes.post("/mount", summary="Say what is mounted")
    def mount(body: MountRequest, who: Asking) -> PrinterStatus:
        parts = body.model_dump(exclude_unset=True)
        for sort, model in PARTS.items():
            if parts.get(sort):
                parts[sort] = service.store.given(model, parts[sort])
        return commands.mount(who, **parts)


def _add_console(routes: APIRouter, service: PrinterService) -> None:
    @routes.post("/command", summary="Send a line by the console")
    def command(body: ConsoleLine, who: Asking) -> dict[Literal["replies"], list[str]]:
        return {"replies": service.console.send(who, body.text)}

    @routes.get("/console", summary="What was typed, answered and refused")
    def console(after: int = 0) -> list[Entry]:
        return service.console.entries(after)


def _add_macros(routes: APIRouter, service: PrinterService) -> None:
    macros = service.macros

    @routes.get("/macros/{profile}", summary="Macros of a profile")
    def listed(profile: str) -> dict[Literal["macros"], list[Macro]]:
        return {"macros": macros.of(profile)}

    @routes.put("/macros/{profile}", summary="Keep a macro, in place of one of its name")
    def save(profile: str, body: Macro, who: Asking) -> dict[Literal["macros"], list[Macro]]:
        macros.save(who, profile, body)
        return listed(profile)

    @routes.delete("/macros/{profile}/{name}", summary="Remove a macro")
    def remove(profile: str, name: str, who: Asking) -> dict[Literal["macros"], list[Macro]]:
        macros.remove(who, profile, name)
        return listed(profile)

    @routes.post("/macros/run/{name}", summary="Run a macro of the printer connected")
    def run(name: str, who: Asking) -> dict[Literal["replies"], list[str]]:
        return {"replies": macros.run(who, name)}


def _add_touching(routes: APIRouter, service: PrinterService) -> None:
    guide = service.guide

    @routes.get("/touch-off", summary="What was read of floor or bath so far; null for nothing")
    def state() -> dict[Literal["touching"], Touching | None]:
        return {"touching": guide.touching}

    @routes.post("/touch-off", summary="Begin to touch off the floor or the bath's surface")
    def start(body: StartTouching, who: Asking) -> dict[Literal["touching"], Touching | None]:
        return {"touching": guide.start(who, body.surface, body.foil_mm)}

    @routes.post("/touch-off/reading", summary="Take the tip's height as a reading")
    def read(who: Asking) -> dict[Literal["touching"], Touching | None]:
        return {"touching": guide.read(who)}

    @routes.post("/touch-off/use", summary="Use the height that three readings agree on")
    def use(who: Asking) -> PrinterStatus:
        return guide.use(who)

    @routes.delete("/touch-off", summary="Forget the readings")
    def give_up(who: Asking) -> dict[Literal["touching"], Touching | None]:
        guide.give_up(who)
        return state()


def _add_changes(routes: APIRouter, service: PrinterService) -> None:
    changing = service.changing

    @routes.post("/change/syringe", summary="Say that a syringe was put in, and how full")
    def syringe(body: NewSyringe, who: Asking) -> PrinterStatus:
        return changing.syringe(who, **dict(body))

    @routes.post("/change/purge", summary="Push bubbles out, a little at a time")
    def purge(body: Push, who: Asking) -> PrinterStatus:
        return changing.purge(who, **dict(body))

    @routes.post("/change/needle", summary="Say that a needle was put in; touch off follows")
    def needle(body: NewNeedle, who: Asking) -> PrinterStatus:
        return changing.needle(who, body.needle)


def _add_calibrations(routes: APIRouter, service: PrinterService) -> None:
    calibrating = service.calibrating

    @routes.get("/calibrations", summary="Calibrations, and what each needs")
    def listed() -> tuple[Wizard, ...]:
        return calibrating.wizards

    @routes.post("/calibrations/{name}/job", summary="Write a test into the workspace's jobs")
    def make(name: str, body: CalibrationRequest, who: Asking) -> CalibrationFiles:
        return calibrating.make(who, name, body)

    @routes.post("/calibrations/{name}/fit", summary="Estimates with 95 % intervals, and notes")
    def fit(name: str, body: Read) -> dict[str, Any]:
        result = calibrating.fit(name, body)
        estimates = {key: asdict(one) for key, one in result.lines.items()}
        return {"estimates": estimates, "notes": result.notes}

    @routes.post("/calibrations/weigh/profile", summary="Write a measured copy of a profile")
    def save(body: Save, who: Asking) -> dict[Literal["message"], str]:
        return {"message": calibrating.save(who, **dict(body))}
