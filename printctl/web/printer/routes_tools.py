"""REST routes of console, macros, touch-off, and syringe or needle changes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from fastapi import APIRouter, Request

from printctl.machine.station import StationStatus
from printctl.web.controls import Principal
from printctl.web.printer import models as m
from printctl.web.printer.macros import Macro
from printctl.web.printer.service import PrinterService
from printctl.web.printer.touch_off import Touching

Who = Callable[[Request], Principal]


def add_tools(routes: APIRouter, service: PrinterService, who: Who) -> None:
    """Add them."""
    _add_console(routes, service, who)
    _add_macros(routes, service, who)
    _add_touching(routes, service, who)
    _add_changes(routes, service, who)


def _add_console(routes: APIRouter, service: PrinterService, who: Who) -> None:
    @routes.post("/command", summary="Send a line by the console")
    def command(body: m.ConsoleLine, request: Request) -> m.Replies:
        return m.Replies(replies=service.console.send(who(request), body.text))

    @routes.get("/console", summary="What was typed, answered and refused")
    def console(after: int = 0) -> list[dict[str, Any]]:
        return [entry.to_dict() for entry in service.console.entries(after)]


def _add_macros(routes: APIRouter, service: PrinterService, who: Who) -> None:
    macros = service.macros

    @routes.get("/macros/{profile}", summary="Macros of a profile")
    def listed(profile: str) -> m.MacroList:
        return m.MacroList(macros=macros.of(profile))

    @routes.put("/macros/{profile}", summary="Keep a macro, in place of one of its name")
    def save(profile: str, body: Macro, request: Request) -> m.MacroList:
        macros.save(who(request), profile, body)
        return m.MacroList(macros=macros.of(profile))

    @routes.delete("/macros/{profile}/{name}", summary="Remove a macro")
    def remove(profile: str, name: str, request: Request) -> m.MacroList:
        macros.remove(who(request), profile, name)
        return m.MacroList(macros=macros.of(profile))

    @routes.post("/macros/run/{name}", summary="Run a macro of the printer connected")
    def run(name: str, request: Request) -> m.Replies:
        return m.Replies(replies=macros.run(who(request), name))


def _add_touching(routes: APIRouter, service: PrinterService, who: Who) -> None:
    guide = service.guide

    def told(touching: Touching | None) -> m.TouchingState:
        return m.TouchingState(touching=None if touching is None else touching.to_dict())

    @routes.get("/touch-off", summary="What was read of floor or bath so far")
    def state() -> m.TouchingState:
        return told(guide.touching)

    @routes.post("/touch-off", summary="Begin to touch off the floor or the bath's surface")
    def start(body: m.StartTouching, request: Request) -> m.TouchingState:
        return told(guide.start(who(request), body.surface, body.foil_mm))

    @routes.post("/touch-off/reading", summary="Take the tip's height as a reading")
    def read(request: Request) -> m.TouchingState:
        return told(guide.read(who(request)))

    @routes.post("/touch-off/use", summary="Use the height that three readings agree on")
    def use(request: Request) -> m.Status:
        return _status(guide.use(who(request)))

    @routes.delete("/touch-off", summary="Forget the readings")
    def give_up(request: Request) -> m.TouchingState:
        guide.give_up(who(request))
        return told(guide.touching)


def _add_changes(routes: APIRouter, service: PrinterService, who: Who) -> None:
    changing = service.changing

    @routes.post("/change/syringe", summary="Say that a syringe was put in, and how full")
    def syringe(body: m.NewSyringe, request: Request) -> m.Status:
        return _status(changing.syringe(who(request), body.syringe, body.ink, body.filled_ul))

    @routes.post("/change/purge", summary="Push bubbles out, a little at a time")
    def purge(body: m.Push, request: Request) -> m.Status:
        return _status(changing.purge(who(request), body.ul, body.ul_s))

    @routes.post("/change/needle", summary="Say that a needle was put in; touch off follows")
    def needle(body: m.NewNeedle, request: Request) -> m.Status:
        return _status(changing.needle(who(request), body.needle))


def _status(status: StationStatus) -> m.Status:
    return m.Status(**status.to_dict(), needs_touch_off=status.mounted.touch_off_due)
