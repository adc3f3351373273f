"""Macro card of the Printer page, with the dialog that edits a macro."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui
from pydantic import ValidationError

from printctl.machine.station import StationState, StationStatus
from printctl.web.controls import Principal
from printctl.web.errors import BadRequestError
from printctl.web.printer.layout import Refresh, button, card, dialog, note, quiet_button
from printctl.web.printer.macros import Macro
from printctl.web.printer.service import PrinterService
from printctl.web.shell.run_or_notify import run_or_notify


def add_macros(service: PrinterService, who: Principal) -> Refresh:
    """A button for each, and a way to edit them."""
    shown: list[object] = [None]
    runs: list[ui.button] = []
    with card("Macros"):
        about = note()
        buttons = ui.row().classes("gap-2")
        edit = _dialog(service, who)
        new = quiet_button("New macro …", lambda: edit(service.store.name(_profile()), None))

    def _profile() -> str:
        return service.status.profile

    def rebuild(profile: str, macros: list[Macro]) -> None:
        buttons.clear()
        runs.clear()
        with buttons:
            for macro in macros:
                with ui.row().classes("gap-1 no-wrap"):
                    runs.append(
                        button(
                            macro.name,
                            lambda m=macro: run_or_notify(service.macros.run, who, m.name),
                        )
                    )
                    change = quiet_button("Edit", lambda m=macro: edit(profile, m))
                    change.props(f'aria-label="Edit {_plain(macro.name)}"')

    def refresh(status: StationStatus) -> None:
        new.set_enabled(status.open)
        profile = service.store.name(status.profile) if status.profile else ""
        macros = service.macros.of(profile) if status.open else []
        if shown[0] != (profile, macros):
            shown[0] = (profile, macros)
            rebuild(profile, macros)
            about.set_text(_about(profile, macros, status.open))
        for one in runs:
            one.set_enabled(status.state is StationState.READY)

    return refresh


def _about(profile: str, macros: list[Macro], is_open: bool) -> str:
    if not is_open:
        return "Each printer profile has its own; connect to see them."
    if not macros:
        return f"{profile} has none yet. A macro is commands as you would type them, under a name."
    return f"Of {profile}; sent like typed commands, until one is refused."


def _plain(text: str) -> str:
    """Without what would end an attribute of Quasar's props."""
    return text.replace('"', "'").replace("\\", "/")


def _dialog(service: PrinterService, who: Principal) -> Callable[[str, Macro | None], None]:
    of = {"profile": "", "was": ""}
    with dialog("Macro") as opened:
        name = ui.input("Name").props("outlined maxlength=40").classes("w-full")
        lines = ui.textarea("Commands, one a line").props("outlined").classes("w-full font-mono")
        with ui.row().classes("gap-2"):
            button("Save", lambda: save())
            remove = quiet_button("Remove", lambda: drop())
            quiet_button("Cancel", opened.close)

    def keep() -> bool:
        commands = tuple(t.strip() for t in str(lines.value or "").splitlines() if t.strip())
        try:
            macro = Macro(name=str(name.value or "").strip(), commands=commands)
        except ValidationError as exc:
            raise BadRequestError(
                "a macro has a name of 1 to 40 characters and 1 to 100 commands"
            ) from exc
        service.macros.save(who, of["profile"], macro)
        if of["was"] and of["was"] != macro.name:
            service.macros.remove(who, of["profile"], of["was"])
        return True

    async def save() -> None:
        if await run_or_notify(keep):
            opened.close()

    async def drop() -> None:
        await run_or_notify(service.macros.remove, who, of["profile"], of["was"])
        opened.close()

    def show(profile: str, macro: Macro | None) -> None:
        of.update(profile=profile, was=macro.name if macro else "")
        name.set_value(macro.name if macro else "")
        lines.set_value("\n".join(macro.commands) if macro else "")
        remove.set_visibility(macro is not None)
        opened.open()

    return show
