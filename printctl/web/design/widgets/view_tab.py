"""Look tab of the Design page: a run's key figures, network, layers, dry run, report, files."""

from __future__ import annotations

from typing import Final

from nicegui import events, ui

from printctl.web.design.run_views import Figure
from printctl.web.design.service import DesignService
from printctl.web.design.widgets.embed import embed
from printctl.web.design.widgets.in_thread import run_in_thread
from printctl.web.errors import WebError

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
        self._note.text = "The view is being made ..." if view in ("network", "layers") else ""
        try:
            await run_in_thread(self._service.page, name, view)
        except Exception as exc:
            # Whatever a view can't show is said in its place; the other views still stand.
            self._note.text = str(exc)
            return
        self._note.text = ""
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
