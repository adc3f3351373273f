"""Dialogs with an accessible name, for screen readers."""

from __future__ import annotations

from nicegui import ui


def dialog_named(name: str) -> ui.dialog:
    """A dialog; its name is read out when it opens."""
    made = ui.dialog()
    made.props["aria-label"] = name
    return made
