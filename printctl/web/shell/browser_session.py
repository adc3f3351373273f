"""Find which browser session (user) the current page is being built for."""

from __future__ import annotations

from nicegui import ui

from printctl.web.controls import Principal


def this_browser() -> Principal:
    """The browser that the page being built or answering is for; set by the guard at the door."""
    request = ui.context.client.request
    principal = getattr(request.state, "principal", None) if request is not None else None
    return principal or Principal("local", "this browser")
