"""Recovery choices on the Job page for an interrupted print: resume, recover, give up."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui

from printctl.web.controls import Principal
from printctl.web.job.card_jobs import way
from printctl.web.job.layout import button, quiet_button, small
from printctl.web.job.service import JobService
from printctl.web.shell.dialogs import dialog_named

Do = Callable[..., Any]
_GO_ON = (
    "Look first: the printer must have kept its power, and nobody may have moved the needle. The "
    "printer is asked for its last line; where that or its position doesn't agree, nothing moves."
)
_GIVE_UP = (
    "The end is written into the print's record. It can't be gone on with afterwards; the printer "
    "may be connected again. Nothing is sent to the printer."
)


class UnfinishedPane:
    """Buttons with a question each; two clicks lead to each of them.

    Parameters
    ----------
    service : JobService
    who : Principal
    job : str
    do : coroutine function
        Calls a function in a thread, and shows what it refuses.
    """

    def __init__(self, service: JobService, who: Principal, job: str, do: Do) -> None:
        self.service, self.who, self.job, self.do = service, who, job, do
        hands = service.hands
        goes = _question("Go on with the print?", _GO_ON, "Yes, go on", self._ask(hands.go_on))
        ends = _question(
            "Give the print up?", _GIVE_UP, "Yes, give it up", self._ask(hands.give_up)
        )
        self._rest = _Rest(self)
        with ui.column().classes("w-full gap-2") as self._box:
            with ui.row().classes("gap-2"):
                self._buttons = {
                    "go_on": button("Go on …", goes.open),
                    "recover": quiet_button("Recover …", self._rest.open),
                    "give_up": quiet_button("Give up …", ends.open),
                }
            self._why = small()

    def show(self, state: dict[str, Any] | None) -> None:
        """Show what is possible, and why the rest isn't."""
        can = {} if state is None else {one["action"]: one for one in state["actions"]}
        offered = [name for name in self._buttons if name in can and can[name]["possible"]]
        self._box.set_visibility(bool(offered) and state is not None and state["ended"])
        for name, made in self._buttons.items():
            made.set_visibility(name in offered)
        if offered:
            self._rest.needs_line = can["recover"]["needs"] == "from_line"
            self._rest.reason = can["recover"]["reason"]
            self._why.set_text("" if "go_on" in offered else f"No Go on: {can['go_on']['reason']}.")

    def _ask(self, work: Callable[..., Any]) -> Callable[[], Any]:
        return lambda: self.do(work, self.who, self.job)


class _Rest:
    """The question of a recovery: what to do by hand, where to begin."""

    def __init__(self, of: UnfinishedPane) -> None:
        self._of, self.needs_line, self.reason = of, False, ""
        with (
            dialog_named("Recover the rest of the print?") as self._dialog,
            ui.card().classes("gap-3 job-dialog"),
        ):
            ui.label("Recover the rest of the print?").classes("text-lg font-semibold")
            small("The rest becomes a job of its own, which is checked and started like any other.")
            self._steps = ui.element("ol").classes("job-steps")
            self._said = ui.label().classes("job-warn")
            self._line = ui.number("Line of the job's file to begin with", min=1, precision=0)
            self._line.props("outlined").classes("w-full")
            with ui.row().classes("gap-2"):
                button("Write the rest as a job", self._write)
                quiet_button("Not now", self._dialog.close)

    async def open(self) -> None:
        """Show what the plan says."""
        self._said.set_text(self.reason)
        self._said.set_visibility(bool(self.reason))
        self._steps.clear()
        if not self.needs_line:
            plan = await self._of.do(self._of.service.hands.recovery, self._of.job)
            with self._steps:
                for text in plan.steps if plan is not None else ():
                    with ui.element("li"):
                        ui.label(text)
        self._dialog.open()

    async def _write(self) -> None:
        line = int(self._line.value) if self._line.value else None
        of = self._of
        self._dialog.close()
        rest = await of.do(of.service.hands.recover, of.who, of.job, line)
        if rest is not None:
            ui.navigate.to(way(rest["job"]))


def _question(title: str, text: str, yes: str, work: Callable[[], Any]) -> ui.dialog:
    """A dialog that asks once more."""
    with dialog_named(title) as dialog, ui.card().classes("gap-3 job-dialog"):
        ui.label(title).classes("text-lg font-semibold")
        ui.label(text)

        async def go() -> None:
            dialog.close()
            await work()

        with ui.row().classes("gap-2"):
            button(yes, go)
            quiet_button("No", dialog.close)
    return dialog
