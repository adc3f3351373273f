"""Compare tab of the Design page: tables of differences and 3D networks of two runs."""

from __future__ import annotations

from collections.abc import Sequence

from nicegui import ui

from printctl.web.design.run_views.compare import Difference
from printctl.web.design.service import DesignService
from printctl.web.design.widgets.embed import embed
from printctl.web.design.widgets.in_thread import run_in_thread
from printctl.web.shell.run_or_notify import run_or_notify


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
