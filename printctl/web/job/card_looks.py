"""Looks card of the Job page: what an observed print shows, what is proposed, the answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final
from urllib.parse import quote

from nicegui import ui

from printctl.link.states import LinkState
from printctl.observe.records import Answer
from printctl.web.api.answers import API
from printctl.web.controls import Principal
from printctl.web.job.layout import button, card, live, quiet_button, run_or_explain, small
from printctl.web.job.looks.look_service import LookTold
from printctl.web.job.service import JobService

_LAST: Final = 12
_LARGE_PX: Final = 1280
_SMALL_PX: Final = 240
_AGAIN_S: Final = 0.5


class LooksCard:
    """The look that holds the print, two buttons where it asks, and a strip of the last looks.

    Hidden for a print that nobody observes.

    Parameters
    ----------
    service : JobService
    who : Principal
    job : str
    cancel : function
        Asks whether the print is to be ended.
    """

    def __init__(
        self, service: JobService, who: Principal, job: str, cancel: Callable[[], None]
    ) -> None:
        self._service, self._who, self._job = service, who, job
        self._told: dict[str, Any] | None = None
        self._shown: tuple[object, ...] | None = None
        self._asking = 0
        with ui.element("div").classes("w-full") as self._all, card("Looks", "job-looks gap-2"):
            self._head = live().classes("text-lg font-semibold")
            self._why = ui.label()
            self._seen = small()
            self._proposed = live().classes("job-warn")
            with ui.row().classes("gap-2") as self._buttons:
                button("Approve", lambda: self._answer("approve"))
                quiet_button("Go on without", lambda: self._answer("go_on"))
                quiet_button("Cancel print", cancel)
            self._problem = live().classes("job-problem")
            self._picture = ui.element("img").classes("job-look")
            self._strip = ui.element("ul").classes("job-strip").props('aria-label="Last looks"')
        self._all.set_visibility(False)
        ui.timer(_AGAIN_S, self._refresh)

    def show(self, told: dict[str, Any] | None) -> None:
        """Take notice of what was heard of the print last; read what it changes soon."""
        self._told = told

    async def _refresh(self) -> None:
        """Read the looks again where the print's state says that there is something new."""
        told = self._told
        if told is None or (key := _key(told)) == self._shown:
            return
        found, said = await run_or_explain(self._service.looks.looks, self._job)
        self._problem.set_text(said)
        self._shown = key
        self._all.set_visibility(bool(found) or bool(said) or told["state"] == LinkState.LOOKING)
        self._show_held(told, found or [])
        self._show_strip(found or [])

    async def _answer(self, word: Answer) -> None:
        found, said = await run_or_explain(
            self._service.looks.answer, self._who, self._job, self._asking, word
        )
        if found is not None:
            self._shown = None
            await self._refresh()
        self._problem.set_text(said)

    # --- the look that holds the print -----------------------------------------------------------

    def _show_held(self, told: dict[str, Any], looks: list[LookTold]) -> None:
        number = told["look"]["number"] if told["look"] else 0
        held = told["state"] in (LinkState.LOOKING, LinkState.PAUSED)
        found = next((one for one in looks if held and one.record.number == number), None)
        self._head.set_text(_head(told, found))
        self._head.set_visibility(bool(self._head.text))
        self._asking = number
        self._show_picture(found)
        self._why.set_text("" if found is None else _sentence(found.record.why))
        self._seen.set_text("" if found is None else found.to_dict()["seen"])
        self._proposed.set_text(_proposed(found) if told["state"] == LinkState.PAUSED else "")
        for one in (self._why, self._seen, self._proposed):
            one.set_visibility(bool(one.text))
        self._buttons.set_visibility(found is not None and found.waits)

    def _show_picture(self, found: LookTold | None) -> None:
        there = found is not None and found.pictured > 0
        self._picture.set_visibility(there)
        if found is not None and there:
            number = found.record.number
            self._picture.props["src"] = self._place(found, _LARGE_PX)
            self._picture.props["alt"] = f"Look {number}: what was expected and what was found"
            self._picture.update()

    def _place(self, found: LookTold, width_px: int) -> str:
        job = quote(self._job, safe="~")
        query = f"width={width_px}&at={found.pictured:.3f}"
        return f"{API}/prints/{job}/looks/{found.record.number}/picture?{query}"

    # --- the strip -------------------------------------------------------------------------------

    def _show_strip(self, looks: list[LookTold]) -> None:
        self._strip.clear()
        with self._strip:
            for one in reversed(looks[-_LAST:]):
                with ui.element("li"):
                    self._one_of_strip(one)

    def _one_of_strip(self, one: LookTold) -> None:
        told, name = one.to_dict(), f"Look {one.record.number}"
        if one.pictured > 0:
            whole = self._place(one, 4096)
            with ui.link(target=whole, new_tab=True).props(f'aria-label="{name}, whole picture"'):
                picture = ui.element("img").props('alt="" loading=lazy')
                picture.props["src"] = self._place(one, _SMALL_PX)
        ui.label(f"{one.record.number}: {told['outcome']}").classes("text-sm")
        small(told["seen"] or "nothing seen")


def _key(told: dict[str, Any]) -> tuple[object, ...]:
    """What of a print's state tells that there is a new look, or another decision on it."""
    look = told["look"] or {}
    return told["started"], told["state"], look.get("number"), look.get("decision")


def _head(told: dict[str, Any], found: LookTold | None) -> str:
    look = told["look"]
    if found is not None:
        return f"Look {found.record.number} at the {found.record.mark}"
    if look is None or told["state"] != LinkState.LOOKING:
        return ""
    return f"Look {look['number']} at the {look['mark']}: a picture is taken and judged"


def _proposed(found: LookTold | None) -> str:
    """What is proposed, or what comes of the answer."""
    if found is None:
        return ""
    if found.waits:
        return f"Proposed: {found.to_dict()['proposed']}. The print waits for your word."
    if found.answer == "approve":
        return (
            "Approved. If the print is still paused in a minute, it can't be done from here: "
            "resume without it, or cancel, in the card Print."
        )
    if found.answer is not None:
        return "Answered; the print goes on in a moment."
    return "Nothing is proposed: see to the cause, then resume or cancel in the card Print."


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
