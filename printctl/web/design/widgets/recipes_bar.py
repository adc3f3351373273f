"""Recipe toolbar of the Design page: choose, create, copy, rename, import, delete, undo."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import events, ui

from printctl.web.design.recipes import SUFFIXES
from printctl.web.design.widgets.editor import Editor
from printctl.web.shell.dialogs import dialog_named
from printctl.web.shell.run_or_notify import run_or_notify
from printctl.web.shell.uploading import upload

Chosen = Callable[[str], Awaitable[None]]


class RecipesBar:
    """A row of what can be done with recipes.

    Parameters
    ----------
    editor : Editor
    chosen : function
        Told of the name of the recipe to be edited; empty for none.
    """

    def __init__(self, editor: Editor, chosen: Chosen) -> None:
        self._editor, self._chosen, self._thrown = editor, chosen, ""
        with ui.row().classes("w-full items-center gap-2"):
            self._select = ui.select([], label="Recipe", on_change=self._selected)
            self._select.props("outlined dense").classes("pc-recipe")
            ui.button("New", on_click=self.begin)
            ui.button("Duplicate", on_click=self._duplicate).props("outline")
            ui.button("Rename", on_click=self._rename).props("outline")
            ui.button("Import", on_click=self._import).props("outline")
            ui.button("Delete", on_click=self._delete).props("outline")
            self._back = ui.button("Take back", on_click=self._restore).props("outline")
        self._back.visible = False

    def refresh(self) -> None:
        """Show the recipes that there are."""
        names = self._editor.recipes.names()
        self._select.set_options(names, value=self._editor.name or None)

    async def _selected(self, event: events.ValueChangeEventArguments[str | None]) -> None:
        if event.value and event.value != self._editor.name:
            await self._chosen(event.value)

    async def begin(self) -> None:
        """Ask for a new recipe's name and what it begins from, and make it."""
        sources = self._editor.recipes.examples()
        with dialog_named("New recipe") as dialog, ui.card().classes("pc-dialog"):
            ui.label("New recipe").classes("pc-h2")
            name = ui.input("Name").props("outlined autofocus").classes("w-full")
            source = ui.select(sources, label="Begin from", value="starter")
            source.props("outlined").classes("w-full")
            self._buttons(dialog, "Make")
        if await dialog:
            await self._go(self._editor.recipes.new, name.value, source.value)

    async def _duplicate(self) -> None:
        name = await self._asked("Duplicate", "Name of the copy", f"{self._editor.name}_2")
        if name:
            await self._go(self._editor.recipes.duplicate, self._editor.name, name)

    async def _rename(self) -> None:
        name = await self._asked("Rename", "New name", self._editor.name)
        if name and name != self._editor.name:
            await self._go(self._editor.recipes.rename, self._editor.name, name)

    async def _asked(self, title: str, label: str, value: str) -> str:
        if not self._editor.name:
            ui.notify("Choose a recipe first", type="warning")
            return ""
        with dialog_named(title) as dialog, ui.card().classes("pc-dialog"):
            ui.label(title).classes("pc-h2")
            name = ui.input(label, value=value).props("outlined autofocus").classes("w-full")
            self._buttons(dialog, title)
        return str(name.value or "") if await dialog else ""

    def _buttons(self, dialog: ui.dialog, done: str) -> None:
        with ui.row().classes("w-full justify-end"):
            ui.button("Cancel", on_click=lambda: dialog.submit(False)).props("flat")
            ui.button(done, on_click=lambda: dialog.submit(True))

    async def _import(self) -> None:
        with dialog_named("Import") as dialog, ui.card().classes("pc-dialog"):
            ui.label("Import").classes("pc-h2")
            ui.label(
                "A recipe (.yaml), or a file that recipes name: "
                f"{', '.join(suffix[1:] for suffix in SUFFIXES)}."
            )

            async def taken(event: events.UploadEventArguments) -> None:
                await self._take(event.file.name, await event.file.read())
                dialog.close()

            upload("Choose a file", taken, ",".join((".yaml", ".yml", *SUFFIXES)))
            ui.button("Close", on_click=dialog.close).props("flat")
        dialog.open()

    async def _take(self, name: str, data: bytes) -> None:
        recipes = self._editor.recipes
        if name.lower().endswith((".yaml", ".yml")):
            await self._go(recipes.take_in, name, data)
        elif (taken := await run_or_notify(recipes.take_file, name, data)) is not None:
            ui.notify(f"{taken} can be named in recipes now", type="positive")
            if self._editor.name and self._editor.saved:
                await run_or_notify(self._editor.load, self._editor.name)
                self._editor.tell(True)

    async def _delete(self) -> None:
        name = self._editor.name
        if not name:
            return
        await run_or_notify(self._editor.recipes.delete, name)
        self._thrown = name
        self._back.text, self._back.visible = f"Take back {name}", True
        await self._chosen(next(iter(self._editor.recipes.names()), ""))

    async def _restore(self) -> None:
        self._back.visible = False
        await self._go(self._editor.recipes.restore, self._thrown)

    async def _go(self, work: Callable[..., Any], *args: Any) -> None:
        made = await run_or_notify(work, *args)
        if made is not None:
            await self._chosen(made.name)
