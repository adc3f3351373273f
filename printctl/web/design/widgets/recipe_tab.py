"""Recipe tab of the Design page: form and text side by side, with the list of errors."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial

from nicegui import events, ui

from printctl.web.design import form as forms
from printctl.web.design.service import DesignService
from printctl.web.design.widgets.editor import Editor
from printctl.web.design.widgets.form_pane import FormPane
from printctl.web.design.widgets.pick_pane import PickPane
from printctl.web.shell.run_or_notify import run_or_notify


class RecipeTab:
    """Form, text, search of a field, and a list of what is wrong; an invitation without a recipe.

    Parameters
    ----------
    editor : Editor
    service : DesignService
    begin : function
        Asks for a new recipe.
    """

    def __init__(
        self, editor: Editor, service: DesignService, begin: Callable[[], Awaitable[None]]
    ) -> None:
        self._editor, self._service = editor, service
        self._places: dict[str, forms.Path] = {}
        with ui.column().classes("w-full items-start gap-2") as self._invitation:
            ui.label("Choose a recipe, make a new one, or begin with an example.")
            ui.button("New recipe", on_click=begin)
        with ui.column().classes("w-full gap-4") as self._body:
            self._build()
        editor.changed.append(self._after)

    def _build(self) -> None:
        with ui.row().classes("w-full items-center gap-2"):
            self._state = ui.label().classes("pc-state-line").props("role=status")
            ui.space()
            self._search = ui.select(
                [], label="Find a field", with_input=True, on_change=self._found
            )
            self._search.props("outlined dense clearable").classes("pc-search")
        self._wrong = ui.column().classes("w-full gap-0")
        self._pick = PickPane(self._editor, self._service)
        with ui.element("div").classes("pc-two"):
            with ui.element("section").props('aria-label="Form"'):
                self._form = FormPane(self._editor)
            with ui.element("section").props('aria-label="Text"'):
                self._text = ui.textarea("Recipe as YAML", on_change=self._typed)
                self._text.props(
                    "outlined autogrow debounce=600 spellcheck=false input-class=pc-mono"
                ).classes("w-full")

    def show(self) -> None:
        """Show the recipe that is loaded."""
        there = bool(self._editor.name)
        self._invitation.visible, self._body.visible = not there, there
        self._form.build()
        self._after(False)

    async def _typed(self, event: events.ValueChangeEventArguments[str | None]) -> None:
        text = event.value or ""
        if text == self._editor.text or not self._editor.name:
            return
        await run_or_notify(self._editor.set_text, text)
        self._editor.tell(True)

    def _found(self, event: events.ValueChangeEventArguments[str | None]) -> None:
        path = self._places.get(event.value or "")
        if path is not None:
            self._form.show(path)
            self._search.value = None

    def _after(self, rebuild: bool) -> None:
        editor = self._editor
        if self._text.value != editor.text:
            self._text.value = editor.text
        self._pick.refresh()
        self._places = self._form.places()
        self._search.set_options(list(self._places))
        count = len(editor.problems)
        wrong = "ready to be made" if not count else f"{count} to mend"
        kept = "saved" if editor.saved else "not saved: this can't be read"
        self._state.text = f"{editor.name}: {wrong} · {kept}" if editor.name else ""
        self._wrong.clear()
        with self._wrong:
            for problem in editor.problems:
                show = partial(self._form.show, problem.path)
                line = ui.button(problem.message, on_click=show)
                line.props("flat no-caps align=left icon=error_outline").classes("pc-problem")
