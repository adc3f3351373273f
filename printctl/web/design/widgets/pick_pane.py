"""Pane of the Recipe tab on which inlets and outlets are picked on the tissue's surface."""

from __future__ import annotations

import math
from typing import Any, Final

from nicegui import events, ui

from printctl.web.design.pick_targets import PickTarget, pick_targets
from printctl.web.design.service import DesignService
from printctl.web.design.widgets.editor import Editor
from printctl.web.design.widgets.embed import embed
from printctl.web.design.widgets.in_thread import run_in_thread
from printctl.web.errors import WebError
from printctl.web.shell.run_or_notify import run_or_notify

_LARGEST_MM: Final = 1e6
_NONE: Final = "Places are picked for grown vessels: grow: tree, closed_loop or forest."


class PickPane:
    """Shows the tissue once it is opened; a click sets what is chosen beside it.

    Parameters
    ----------
    editor : Editor
    service : DesignService
    """

    def __init__(self, editor: Editor, service: DesignService) -> None:
        self._editor, self._service, self._shown = editor, service, ""
        self._targets: dict[str, PickTarget] = {}
        box = ui.expansion("Pick inlets on the tissue", on_value_change=self._opened)
        self._box = box.classes("w-full pc-part").props("dense-toggle header-class=pc-part-head")
        with box:
            with ui.row().classes("w-full items-center gap-2"):
                self._select = ui.select([], label="A click on the surface sets")
                self._select.props("outlined dense").classes("pc-recipe")
                ui.button("Show the tissue anew", on_click=self._show).props("flat")
            self._note = ui.label().classes("pc-message").props("role=status")
            self._frame = ui.column().classes("w-full pc-pick")
        ui.on("pc_pick", self._picked)

    def refresh(self) -> None:
        """Offer what the recipe as it is has places for."""
        self._targets = {one.name: one for one in pick_targets(self._editor.data)}
        names = list(self._targets)
        now = self._select.value
        self._select.set_options(names, value=now if now in names else next(iter(names), None))
        if self._shown and self._shown != self._editor.name:
            self._box.value = False
            self._frame.clear()
            self._shown, self._note.text = "", ""

    async def _opened(self) -> None:
        if self._box.value and self._shown != self._editor.name:
            await self._show()

    async def _show(self) -> None:
        name = self._shown = self._editor.name
        self._frame.clear()
        self._note.text = "The tissue is being made ..."
        try:
            await run_in_thread(self._service.tissue, name)
        except WebError as exc:
            self._note.text = str(exc)
            return
        self._note.text = "" if self._targets else _NONE
        with self._frame:
            embed(f"/api/v1/recipes/{name}/tissue", f"Tissue of {name}")

    async def _picked(self, event: events.GenericEventArguments) -> None:
        at, target = place_of(event.args), self._targets.get(str(self._select.value))
        if at is None or target is None:
            self._note.text = _NONE
            return
        value = target.value(self._editor.data, at)
        await run_or_notify(self._editor.put, target.path, value)
        self._editor.tell(True)
        where = ", ".join(f"{x:.3f}" for x in at)
        self._note.text = f"{target.name}: {where} mm"


def place_of(given: Any) -> list[float] | None:
    """Return three numbers that a frame sent, or None for anything else."""
    at = given.get("at") if isinstance(given, dict) else None
    if not isinstance(at, list) or len(at) != 3:
        return None
    if any(isinstance(x, bool) or not isinstance(x, int | float) for x in at):
        return None
    place = [float(x) for x in at]
    return place if all(math.isfinite(x) and abs(x) < _LARGEST_MM for x in place) else None
