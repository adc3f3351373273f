"""The design page: recipes, form, and what a run made."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, Final

from nicegui import events, ui

from printctl.pipeline.run_options import TOOLPATH_NAMES
from printctl.web.design import form as forms
from printctl.web.design.editor import Editor
from printctl.web.design.embed import embed, follow_theme, make_in_thread, run_in_thread
from printctl.web.design.form_widgets import FormPane, PickPane
from printctl.web.design.recipes import SUFFIXES
from printctl.web.design.run_views import Difference, Figure
from printctl.web.design.runs import LAST_STAGE, RunProgress
from printctl.web.design.service import DesignService
from printctl.web.errors import WebError
from printctl.web.shell.frame import add_unusable_names, dialog_named, frame, run_or_notify, upload

# Recipe toolbar of the Design page: choose, create, copy, rename, import, delete, undo.

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


# Recipe tab of the Design page: form and text side by side, with the list of errors.


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


# Make tab of the Design page: start or cancel a run, follow it, continue after the print.

_WORDS = {
    "never": "not made yet",
    "starting": "starting",
    "running": "being made",
    "done": "made",
    "failed": "failed",
    "interrupted": "broken off",
}
_MARKS = {"waiting": "·", "running": "▸", "done": "✓", "failed": "✕"}


class MakeTab:
    """Starts, follows and cancels the run of the recipe that is edited."""

    def __init__(self, service: DesignService, editor: Editor) -> None:
        self._service, self._editor = service, editor
        self._shown: RunProgress | None = None
        with ui.row().classes("w-full items-center gap-2"):
            self._make = ui.button("Make the design", on_click=self._start)
            names = {name: name for name in TOOLPATH_NAMES}
            self._until = ui.select(names, label="As far as", value=LAST_STAGE)
            self._until.props("outlined dense").classes("pc-until")
            self._cancel = ui.button("Cancel", on_click=self._stop).props("outline")
            ui.space()
            self._continue = ui.button(
                "Continue after the print: scan, register, report", on_click=self._go_on
            ).props("outline")
        self._state = ui.label().classes("pc-state-line").props("role=status")
        self._message = ui.label().classes("pc-message")
        self._stages = ui.column().classes("w-full gap-1")
        with ui.row().classes("gap-4"):
            self._to_job = ui.link("Print it in the Job room", "/job")
            self._to_look = ui.link("See the files of this run", "/design")
        ui.timer(1.0, self._refresh)

    async def _start(self) -> None:
        await run_or_notify(self._service.runs.start, self._editor.name, self._until.value)
        await self._refresh()

    async def _go_on(self) -> None:
        await run_or_notify(self._service.runs.go_on, self._editor.name)
        await self._refresh()

    async def _stop(self) -> None:
        await run_or_notify(self._service.runs.cancel, self._editor.name)
        await self._refresh()

    async def _refresh(self) -> None:
        name = self._editor.name
        if not name:
            return
        now, printed = await run_in_thread(self._look, name)
        self._make.set_enabled(not now.going_on and not self._editor.problems)
        self._cancel.set_enabled(now.going_on)
        self._continue.set_enabled(not now.going_on and printed == "done")
        if now != self._shown:
            self._shown = now
            self._show(now)

    def _look(self, name: str) -> tuple[RunProgress, str]:
        progress = self._service.runs.progress(name)
        return progress, "" if progress.going_on else self._service.runs.print_state(name)

    def _show(self, now: RunProgress) -> None:
        far = f" as far as {now.until}" if now.until and now.state == "done" else ""
        self._state.text = f"{now.name}: {_WORDS[now.state]}{far}"
        self._message.text = now.message
        has_job = now.state == "done" and now.until in (LAST_STAGE, "dry run", "toolpath")
        self._to_job.visible = has_job
        self._to_job.props(f'href="/job?job=run~{now.name}"')
        self._to_look.props(f'href="/design?recipe={now.name}&tab=look"')
        self._to_look.visible = now.state == "done"
        self._stages.clear()
        with self._stages:
            for stage in now.stages:
                with ui.row().classes("w-full items-center no-wrap pc-stage"):
                    ui.label(f"{_MARKS[stage.state]} {stage.name}").classes("pc-stage-name")
                    bar = ui.linear_progress(stage.fraction, show_value=False)
                    bar.props(f'aria-label="{stage.name}"').classes("pc-stage-bar")
                    ui.label(f"{stage.state}: {stage.note}" if stage.note else stage.state).classes(
                        "pc-stage-note"
                    )
                for remark in stage.remarks:
                    ui.label(remark).classes("pc-quiet pc-remark")


# Look tab of the Design page: a run's key figures, network, layers, dry run, report, files.

VIEWS: Final = {
    "network": "Network in 3D",
    "layers": "Layers and passes",
    "dry_run": "Dry run",
    "report": "Report",
}


class ViewTab:
    """Shows one run."""

    def __init__(self, service: DesignService) -> None:
        self._service, self._run = service, ""
        with ui.row().classes("w-full items-center gap-2"):
            self._select = ui.select([], label="Run", on_change=self._chosen)
            self._select.props("outlined dense").classes("pc-recipe")
            self._view = ui.toggle(VIEWS, value="network", on_change=self._show_view)
            self._view.props("no-caps").classes("pc-toggle")
        self._note = ui.label().classes("pc-message").props("role=status")
        self._figures = ui.element("dl").classes("pc-figures")
        self._frame = ui.column().classes("w-full")
        with ui.expansion("Files").classes("w-full pc-part"):
            self._files = ui.row().classes("gap-3")

    async def refresh(self, name: str = "") -> None:
        """Show the runs that there are, and one of them."""
        rows = await run_in_thread(self._service.runs.rows)
        names = [row.name for row in rows if row.state != "never"]
        wanted = name if name in names else self._run if self._run in names else ""
        wanted = wanted or (names[0] if names else "")
        self._select.set_options(names, value=wanted or None)
        self._note.text = "" if names else "Nothing is made yet: make a recipe's design first."
        if wanted:
            await self.show(wanted)

    async def _chosen(self, event: events.ValueChangeEventArguments[str | None]) -> None:
        if event.value and event.value != self._run:
            await self.show(event.value)

    async def show(self, name: str) -> None:
        """Show a run."""
        self._run = name
        try:
            figures = await run_in_thread(self._service.figures, name)
            files = await run_in_thread(self._service.artefacts, name)
        except WebError as exc:
            self._note.text = str(exc)
            return
        show_figures(self._figures, figures)
        self._files.clear()
        with self._files:
            for file in files:
                ui.link(file, f"/api/v1/runs/{name}/files/{file}").classes("pc-file")
        await self._show_view()

    async def _show_view(self) -> None:
        name, view = self._run, self._view.value
        if not name:
            return
        self._frame.clear()
        made = view in ("network", "layers")
        self._note.text = "The view is being made ..." if made else ""
        problem = ""
        try:
            await (make_in_thread if made else run_in_thread)(self._service.page, name, view)
        except Exception as exc:
            # Whatever a view can't show is said in its place; the other views still stand.
            problem = str(exc)
        if (name, view) != (self._run, self._view.value):
            return  # another was chosen meanwhile
        self._note.text = problem
        if problem:
            return
        with self._frame:
            embed(f"/api/v1/runs/{name}/pages/{view}", f"{VIEWS[view]} of {name}")


def show_figures(box: ui.element, figures: list[Figure]) -> None:
    """Key figures as pairs of name and value."""
    box.clear()
    with box:
        for figure in figures:
            with ui.element("div"):
                with ui.element("dt"):
                    ui.label(figure.name)
                with ui.element("dd"):
                    ui.label(figure.text)


# Compare tab of the Design page: tables of differences and 3D networks of two runs.


class CompareTab:
    """Tables of what differs, and both networks, seen from the same side."""

    def __init__(self, service: DesignService) -> None:
        self._service, self._asked = service, 0
        with ui.row().classes("w-full items-center gap-2"):
            self._one = ui.select([], label="One run", on_change=self._show)
            self._other = ui.select([], label="The other", on_change=self._show)
            for select in (self._one, self._other):
                select.props("outlined dense").classes("pc-recipe")
        self._box = ui.column().classes("w-full")

    async def refresh(self) -> None:
        """Show the runs that there are."""
        rows = await run_in_thread(self._service.runs.rows)
        names = [row.name for row in rows if row.state != "never"]
        for select, place in ((self._one, 0), (self._other, 1)):
            value = select.value if select.value in names else None
            value = value or (names[place] if len(names) > place else None)
            select.set_options(names, value=value)

    async def _show(self) -> None:
        one, other = self._one.value, self._other.value
        self._asked += 1
        asked = self._asked
        if not one or not other or one == other:
            self._box.clear()
            return
        compared = await run_or_notify(self._service.compare, one, other)
        for name in (one, other):
            await run_or_notify(self._service.page, name, "network")
        if compared is None or asked != self._asked:  # another pair was chosen meanwhile
            return
        self._box.clear()
        with self._box:
            with ui.element("div").classes("pc-two pc-linked"):
                for name in (one, other):
                    embed(f"/api/v1/runs/{name}/pages/network", f"Network of {name}")
            _table("Key figures", "Figure", compared.figures, (one, other))
            _table("What the recipes say otherwise", "Key", compared.recipe, (one, other))


def _table(title: str, first: str, rows: Sequence[Difference], names: tuple[str, str]) -> None:
    ui.label(title).classes("pc-h2").props("role=heading aria-level=2")
    if not rows:
        ui.label("Nothing.")
        return
    columns = [
        {"name": "name", "label": first, "field": "name", "align": "left"},
        {"name": "one", "label": names[0], "field": "one", "align": "right"},
        {"name": "other", "label": names[1], "field": "other", "align": "right"},
        {"name": "change", "label": "Change", "field": "change", "align": "right"},
    ]
    table = ui.table(rows=[vars(row) for row in rows], columns=columns, row_key="name")
    table.props("flat bordered dense wrap-cells hide-pagination").classes("w-full")


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
        workspace = self._service.core.workspace
        await add_unusable_names(workspace, "recipes/*.yaml", "runs/*")
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
