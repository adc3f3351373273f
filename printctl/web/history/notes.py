"""Notes card of the History page: an operator's lots, cells, steps and remarks on a print."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from nicegui import ui

from printctl.history.table import local_time
from printctl.web.history.layout import card, facts

NAMES: Final = {
    "operator": "Operator",
    "ink_lot": "Lot of the ink",
    "bath_lot": "Lot of the bath",
    "needle_lot": "Lot of the needle",
    "cells": "Cells",
    "passage": "Passage",
    "density_per_ml": "Density, cells per mL",
    "viability_percent": "Viability when mixed, %",
    "mixed_at": "Mixed",
    "viability_min": "Time the cells have, min",
    "sterility": "Sterility",
    "ticked": "Checklist",
}
_LISTS: Final = {"steps": "Steps after the print", "notes": "Notes"}
_UNNAMED: Final = ("text", "note", "step", "name")
_MOST: Final = 500
_LONGEST: Final = 4000


def note_card(note: Mapping[str, Any]) -> None:
    """Show the record; nothing where nothing was noted."""
    rows = list(filled_values(note))
    lists = {name: note[key] for key, name in _LISTS.items() if isinstance(note.get(key), list)}
    if not rows and not any(lists.values()):
        return
    with card("What the operator noted"):
        facts(rows)
        for name, entries in lists.items():
            if entries:
                ui.label(name).classes("ph-bad")
                with ui.element("ul"):
                    for entry in entries[:_MOST]:
                        with ui.element("li"):
                            ui.label(format_entry(entry)).style("white-space:pre-wrap")


def filled_values(note: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Names and values; those that nobody filled in are left out."""
    values = note.get("values")
    if not isinstance(values, dict):
        return
    for key, value in values.items():
        if value in (None, "", {}, []):
            continue
        if key == "ticked" and isinstance(value, dict):
            done = [name for name, ticked in value.items() if ticked is True]
            value = f"{len(done)} of {len(value)} points ticked before the start"
        elif key == "mixed_at" and isinstance(value, int | float):
            value = local_time(float(value))
        elif isinstance(value, float):
            value = f"{value:,.0f}".replace(",", "\N{THIN SPACE}") if value >= 1e4 else f"{value:g}"
        yield NAMES.get(key, str(key).replace("_", " ")), str(value)[:_LONGEST]


def format_entry(entry: Any) -> str:
    """One step or note in a line: when, who, what."""
    if not isinstance(entry, dict):
        return str(entry)[:_LONGEST]
    at = entry.get("at")
    when = local_time(float(at)) if isinstance(at, int | float) else ""
    rest = {k: v for k, v in entry.items() if k not in ("at", "who") and v not in (None, "")}
    words = [_words(k, v) for k, v in rest.items()]
    return "  ".join(filter(None, (when, str(entry.get("who") or ""), *words)))[:_LONGEST]


def _words(key: str, value: Any) -> str:
    if isinstance(value, bool):
        return f"({key})" if value else f"(not {key})"
    return str(value) if key in _UNNAMED else f"{key}: {value}"
