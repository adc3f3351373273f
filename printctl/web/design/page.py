"""Lay out the Design page at /design: recipe toolbar; tabs to edit, run, view and compare."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from nicegui import events, ui

from printctl.web.design.service import DesignService
from printctl.web.design.widgets.compare_tab import CompareTab
from printctl.web.design.widgets.editor import Editor
from printctl.web.design.widgets.embed import follow_theme
from printctl.web.design.widgets.make_tab import MakeTab
from printctl.web.design.widgets.recipe_tab import RecipeTab
from printctl.web.design.widgets.recipes_bar import RecipesBar
from printctl.web.design.widgets.view_tab import ViewTab
from printctl.web.shell.frame import frame
from printctl.web.shell.run_or_notify import run_or_notify

_TABS = {"recipe": "Recipe", "make": "Make", "look": "Look", "compare": "Compare"}


@cache
def room_style() -> str:
    """The style of the Design and Scan rooms."""
    return Path(__file__).with_name("room.css").read_text(encoding="utf-8")


def register(service: DesignService) -> None:
    """Define ``/design``."""

    @ui.page("/design", response_timeout=30.0)  # else no frame, no stop
    async def design(recipe: str = "", tab: str = "recipe") -> None:
        ui.add_css(room_style())
        with frame("/design"):
            await _Page(service).build(recipe, tab if tab in _TABS else "recipe")


class _Page:
    """What one browser sees."""

    def __init__(self, service: DesignService) -> None:
        self._service = service
        self._editor, self._tab = Editor(service.recipes), "recipe"

    async def build(self, recipe: str, tab: str) -> None:
        """Make the page, with a recipe and a tab to begin with."""
        self._tab = tab
        self._bar = RecipesBar(self._editor, self._edit)
        with ui.tabs(on_change=self._turned).props("no-caps align=left") as tabs:
            for key, name in _TABS.items():
                ui.tab(key, label=name)
        with ui.tab_panels(tabs, value=tab, animated=False).classes("w-full pc-panels"):
            with ui.tab_panel("recipe"):
                self._recipe = RecipeTab(self._editor, self._service, self._bar.begin)
            with ui.tab_panel("make"):
                self._make = MakeTab(self._service, self._editor)
            with ui.tab_panel("look"):
                self._look = ViewTab(self._service)
            with ui.tab_panel("compare"):
                self._compare = CompareTab(self._service)
        await ui.context.client.connected()
        follow_theme()
        names = self._service.recipes.names()
        await self._edit(recipe if recipe in names else next(iter(names), ""))
        await self._fill(tab)

    async def _edit(self, name: str) -> None:
        if name:
            await run_or_notify(self._editor.load, name)
        else:
            self._editor.name = ""
        self._bar.refresh()
        self._recipe.show()
        self._note_address()

    def _note_address(self) -> None:
        """Let the page's address say what is seen, so that a reload comes back to it."""
        ui.navigate.history.replace(f"/design?recipe={self._editor.name}&tab={self._tab}")

    async def _turned(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._tab = str(event.value or "recipe")
        self._note_address()
        await self._fill(self._tab)

    async def _fill(self, tab: str) -> None:
        if tab == "look":
            await self._look.refresh(self._editor.name)
        elif tab == "compare":
            await self._compare.refresh()
