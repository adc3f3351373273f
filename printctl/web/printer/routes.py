"""REST of the printer: what is sent, what can be chosen, and routes."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Annotated, Literal

from fastapi import APIRouter
from pydantic import Field

from firmware_profiles import Bath, Dish, Facts, Ink, Needle, Printer, ProfileError, Syringe
from printctl.machine.ports.detection import PortInfo, list_ports, matches, rates_to_try
from printctl.web.printer.calibration import MM, WIZARDS, Calibrating, Wizard
from printctl.web.printer.console import Console, Macros
from printctl.web.printer.part_change import Changing, Guide, Name, NameOrNone, Push
from printctl.web.printer.service import PrinterService
from printctl.web.printer.status import PrinterStatus, way_out_mm
from printctl.web.profile_store import PARTS, ProfileStore
from printctl.web.rest import API, REFUSALS, Asking, Body


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


class MountRequest(Body):
    """What is mounted; keys left out stay as they are, an empty one takes away.

    How much ink a syringe holds that is named isn't known unless it is ``full``.
    """

    needle: NameOrNone | None = None
    syringe: NameOrNone | None = None
    ink: NameOrNone | None = None
    dish: NameOrNone | None = None
    bath: NameOrNone | None = None
    dish_centre_mm: tuple[MM, MM] | None = None
    bath_level_mm: MM | None = None
    bath_depth_mm: MM | None = None
    full: bool = False


@dataclass(frozen=True)
class FoundPort(PortInfo):
    """A port, and the profiles whose USB id it has."""

    profiles: tuple[str, ...]


@dataclass(frozen=True)
class PrinterChoice:
    """A printer profile that can be connected.

    ``starting_values`` are keys whose values weren't measured at the machine. ``bauds`` (Bd) begin
    with the profile's own, then those that ``auto`` tries.
    """

    name: str
    summary: str
    starting_values: tuple[str, ...]
    bauds: tuple[int, ...]


@dataclass(frozen=True)
class PartChoice:
    """A part that can be mounted; ``volume_ul`` is a syringe's."""

    name: str
    about: str
    volume_ul: float | None = None


def _part(store: ProfileStore, model: type[Facts], name: str) -> PartChoice:
    try:
        part = store.load(model, name)
    except (ProfileError, OSError) as exc:  # a file of the user's own; mounting it is refused
        return PartChoice(name, f"can't be read: {exc}")
    if isinstance(part, Needle):
        return PartChoice(name, f"bore {part.inner_mm:g} mm, {part.length_mm:g} mm long")
    if isinstance(part, Syringe):
        return PartChoice(name, f"{part.volume_ul:g} µL", part.volume_ul)
    if isinstance(part, Ink):
        low, high = part.temperature_c.low, part.temperature_c.high
        return PartChoice(name, f"held at {low:g} to {high:g} °C")
    if isinstance(part, Dish):
        wide = "Ø " if part.shape == "round" else f"{part.inner_x_mm:g} × "
        return PartChoice(name, f"{wide}{part.inner_y_mm:g} mm, wall {part.wall_mm:g} mm")
    assert isinstance(part, Bath)
    return PartChoice(name, f"yields at {part.yield_stress_pa:g} Pa")


def summary(printer: Printer) -> str:
    """Describe a printer on one line."""
    x, y, z = (f"{s.low:g} to {s.high:g}" for s in (printer.x_mm, printer.y_mm, printer.z_mm))
    pushes = (
        f"pneumatic, {printer.pneumatic.pressure_kpa:g} kPa"
        if printer.pneumatic
        else f"plunger, {printer.plunger_travel_mm:g} mm of travel"
    )
    heads = f", {printer.head_count} heads" if printer.heads else ""
    return (
        f"{printer.name}: {printer.firmware}, {printer.baud} Bd, X {x}, Y {y}, Z {z} mm; "
        f"{pushes}{heads}"
    )


def router(service: PrinterService) -> APIRouter:
    """Routes under ``/api/v1/printer``."""
    routes = APIRouter(prefix=f"{API}/printer", tags=["printer"], responses=REFUSALS)
    _add_connection(routes, service)
    _add_moves(routes, service)
    _add_the_rest(routes, service)
    return routes


def _add_connection(routes: APIRouter, service: PrinterService) -> None:
    store = service.store

    @routes.get("/status", summary="Last known status of the printer")
    def status() -> PrinterStatus:
        return service.status

    def printers() -> dict[str, Printer]:
        return {name: store.load(Printer, name) for name in store.printers()}

    @routes.get("/ports", summary="Serial ports, and whose USB id each has; opens none")
    def ports() -> list[FoundPort]:
        known = printers().items()
        return [
            FoundPort(
                **asdict(port), profiles=tuple(name for name, one in known if matches(one, port))
            )
            for port in list_ports()
        ]

    @routes.get("/profiles", summary="Printer profiles that can be connected")
    def profiles() -> list[PrinterChoice]:
        return [
            PrinterChoice(name, summary(one), one.starting_values, rates_to_try(one))
            for name, one in printers().items()
        ]

    @routes.get("/parts", summary="Needles, syringes, inks, dishes and baths to choose from")
    def parts() -> dict[str, list[PartChoice]]:
        return {
            sort: [_part(store, model, name) for name in store.names(model)]
            for sort, model in PARTS.items()
        }

    @routes.post("/connect", summary="Connect a printer")
    def connect(body: ConnectTo, who: Asking) -> PrinterStatus:
        return service.connect(who, **dict(body))

    routes.post("/disconnect", summary="Let go of the port; heaters go off")(service.disconnect)

    @routes.post("/reconnect", summary="Open the port again after a halt or a lost port")
    def reconnect(who: Asking) -> PrinterStatus:
        return service.heard(service.ask(who).reconnect())

    routes.get("/temperatures", summary="The last ten minutes, by columns")(service.plots.columns)


def _add_moves(routes: APIRouter, service: PrinterService) -> None:
    @routes.post("/jog", summary="Move the tip by a step")
    def jog(body: Jog, who: Asking) -> PrinterStatus:
        with service.moving(who) as station:
            return service.heard(station.jog(**dict(body)))

    @routes.post("/lift-out", summary="Move the tip straight up, out of the bath")
    def lift_out(who: Asking) -> PrinterStatus:
        with service.moving(who) as station:
            return service.heard(station.jog("z", way_out_mm(station.status)))

    @routes.post("/home", summary="Home axes")
    def home(body: Home, who: Asking) -> PrinterStatus:
        with service.moving(who) as station:
            return service.heard(station.home(**dict(body)))

    @routes.post("/set-position", summary="Say where the tip stands; nothing moves")
    def set_position(body: Place, who: Asking) -> PrinterStatus:
        with service.moving(who) as station:
            return service.heard(station.set_position(**dict(body)))

    @routes.post("/stop-motion", summary="Stop a move by hand; needs no controls")
    def stop_motion() -> PrinterStatus:
        return service.heard(service.station().stop_motion())

    @routes.post("/heat", summary="Set a heater's target")
    def heat(body: Heat, who: Asking) -> PrinterStatus:
        return service.heard(service.ask(who).heat(**dict(body)))

    @routes.post("/heaters-off", summary="Set every target to 0")
    def heaters_off(who: Asking) -> PrinterStatus:
        station = service.ask(who)
        status = station.status
        for one in status.temperatures:
            if one.target_c is not None:
                status = station.heat(one.name, 0.0)
        return service.heard(status)

    @routes.post("/plunger", summary="Push or draw back ink")
    def plunger(body: Push, who: Asking) -> PrinterStatus:
        with service.moving(who) as station:
            return service.heard(station.plunger(**dict(body)))

    @routes.post("/mount", summary="Say what is mounted")
    def mount(body: MountRequest, who: Asking) -> PrinterStatus:
        parts = body.model_dump(exclude_unset=True)
        for sort, model in PARTS.items():
            if parts.get(sort):
                parts[sort] = service.store.given(model, parts[sort])
        if parts.pop("full", False):
            parts["plunger_mm"] = 0.0
        elif "syringe" in parts:
            parts["plunger_mm"] = None
        return service.heard(service.ask(who).mount(**parts))


def _add_the_rest(routes: APIRouter, service: PrinterService) -> None:
    """Add the routes that are methods of what keeps a state of its own."""
    get, post, put, delete = routes.get, routes.post, routes.put, routes.delete
    console = Console(service)
    post("/command", summary="Send a line by the console")(console.command)
    get("/console", summary="What was typed, answered and refused")(console.console)

    macros = Macros(service, console)
    get("/macros/{profile}", summary="Macros of a profile")(macros.listed)
    put("/macros/{profile}", summary="Keep a macro, in place of one of its name")(macros.save)
    delete("/macros/{profile}/{name}", summary="Remove a macro")(macros.remove)
    post("/macros/run/{name}", summary="Run a macro of the printer connected")(macros.run)

    guide, what = Guide(service), "What was read of floor or bath so far; null for nothing"
    get("/touch-off", summary=what)(guide.state)
    post("/touch-off", summary="Begin to touch off the floor or the bath's surface")(guide.start)
    post("/touch-off/reading", summary="Take the tip's height as a reading")(guide.read)
    post("/touch-off/use", summary="Use the height that three readings agree on")(guide.use)
    delete("/touch-off", summary="Forget the readings")(guide.give_up)

    changing = Changing(service)
    post("/change/syringe", summary="Say that a syringe was put in, and how full")(changing.syringe)
    post("/change/purge", summary="Push bubbles out, a little at a time")(changing.purge)
    post("/change/needle", summary="Say that a needle was put in; touch off follows")(
        changing.needle
    )

    @get("/calibrations", summary="Calibrations, and what each needs")
    def listed() -> tuple[Wizard, ...]:
        return WIZARDS

    calibrating, path = Calibrating(service), "/calibrations/{name}"
    post(f"{path}/job", summary="Write a test into the workspace's jobs")(calibrating.make)
    post(f"{path}/fit", summary="Estimates with 95 % intervals, and notes")(calibrating.fit)
    post("/calibrations/weigh/profile", summary="Write a measured copy of a profile")(
        calibrating.save
    )
