"""The rooms of the page: their services, their part of the API, their pages."""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Final

from fastapi import APIRouter

from printctl.web.core import Core

ROOMS: Final = ("printer", "job", "design", "scan", "history")


@dataclass(frozen=True)
class Services:
    """What the rooms do, by the room's name."""

    by_room: dict[str, Any] = field(default_factory=dict)


def make_services(core: Core) -> Services:
    """Make the service of each room."""
    found = {}
    for room in ROOMS:
        if find_spec(f"printctl.web.{room}.service"):
            module = import_module(f"printctl.web.{room}.service")
            found[room] = getattr(module, f"{room.capitalize()}Service")(core)
    return Services(found)


def routers(services: Services) -> list[APIRouter]:
    """The rooms' parts of the API."""
    return [
        import_module(f"printctl.web.{room}.routes").router(service)
        for room, service in services.by_room.items()
        if find_spec(f"printctl.web.{room}.routes")
    ]


def register_pages(services: Services) -> None:
    """Define the rooms' pages; a room that isn't there has an empty one."""
    for room in ROOMS:
        if room in services.by_room and find_spec(f"printctl.web.{room}.page"):
            import_module(f"printctl.web.{room}.page").register(services.by_room[room])
        else:
            _empty(f"/{room}")


def _empty(path: str) -> None:
    from nicegui import ui  # Takes half a second, and the API does without.

    from printctl.web.shell.frame import frame

    @ui.page(path)
    def page() -> None:
        with frame(path):
            ui.label("Nothing here yet.")
