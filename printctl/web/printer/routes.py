"""REST routes of the Printer page: connection, manual control."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request

from firmware_profiles import Bath, Dish, Facts, Ink, Needle, Printer, Syringe
from printctl.machine.station import StationStatus
from printctl.web.controls import Principal
from printctl.web.printer import models as m
from printctl.web.printer.ports import summary
from printctl.web.printer.routes_calibration import add_calibration
from printctl.web.printer.routes_tools import add_tools
from printctl.web.printer.service import PrinterService

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


def status_of(status: StationStatus) -> m.Status:
    """A status as it is given."""
    return m.Status(**status.to_dict(), needs_touch_off=status.mounted.touch_off_due)


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
    def status() -> m.Status:
        return status_of(service.status)

    @routes.get("/ports", summary="Serial ports, and whose USB id each has; opens none")
    def ports() -> list[m.Port]:
        return [m.Port(**vars(port)) for port in service.ports()]

    @routes.get("/profiles", summary="Printer profiles that can be connected")
    def profiles() -> list[m.Profile]:
        ports = []
        for name in service.store.printers():
            printer = service.store.load(Printer, name)
            one = m.Profile(
                name=name, summary=summary(printer), starting_values=printer.starting_values
            )
            ports.append(one)
        return ports

    @routes.post("/connect", summary="Connect a printer")
    def connect(body: m.ConnectTo, request: Request) -> m.Status:
        return status_of(
            service.connect(requesting_user(request), body.profile, body.port, body.baud)
        )

    @routes.post("/disconnect", summary="Let go of the port; heaters go off")
    def disconnect(request: Request) -> m.Status:
        return status_of(service.disconnect(requesting_user(request)))

    @routes.post("/reconnect", summary="Open the port again after a halt or a lost port")
    def reconnect(request: Request) -> m.Status:
        return status_of(service.reconnect(requesting_user(request)))

    @routes.get("/temperatures", summary="The last ten minutes, by columns")
    def temperatures() -> dict[str, Any]:
        return service.plots.columns()


def _add_hands(routes: APIRouter, service: PrinterService) -> None:
    hands = service.hands

    @routes.post("/jog", summary="Move the tip by a step")
    def jog(body: m.Jog, request: Request) -> m.Status:
        return status_of(hands.jog(requesting_user(request), body.axis, body.mm, body.speed_mm_s))

    @routes.post("/lift-out", summary="Move the tip straight up, out of the bath")
    def lift_out(request: Request) -> m.Status:
        return status_of(hands.lift_out(requesting_user(request)))

    @routes.post("/home", summary="Home axes")
    def home(body: m.Home, request: Request) -> m.Status:
        return status_of(
            hands.home(requesting_user(request), body.axes, needle_off=body.needle_off)
        )

    @routes.post("/set-position", summary="Say where the tip stands; nothing moves")
    def set_position(body: m.Place, request: Request) -> m.Status:
        return status_of(hands.set_position(requesting_user(request), body.x, body.y, body.z))

    @routes.post("/stop-motion", summary="Stop a move by hand; needs no controls")
    def stop_motion() -> m.Status:
        return status_of(service.stop_motion())

    @routes.post("/heat", summary="Set a heater's target")
    def heat(body: m.Heat, request: Request) -> m.Status:
        return status_of(hands.heat(requesting_user(request), body.name, body.celsius))

    @routes.post("/heaters-off", summary="Set every target to 0")
    def heaters_off(request: Request) -> m.Status:
        return status_of(hands.heaters_off(requesting_user(request)))

    @routes.post("/plunger", summary="Push or draw back ink")
    def plunger(body: m.Push, request: Request) -> m.Status:
        return status_of(hands.plunger(requesting_user(request), body.ul, body.ul_s))

    @routes.post("/mount", summary="Say what is mounted")
    def mount(body: m.MountRequest, request: Request) -> m.Status:
        parts = body.model_dump(exclude_unset=True)
        for key, model in _SORTS.items():
            if parts.get(key):
                parts[key] = service.store.given(model, parts[key])
        return status_of(hands.mount(requesting_user(request), **parts))
