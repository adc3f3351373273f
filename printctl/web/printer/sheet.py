"""Editable table of a calibration's readings on the Printer page."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from nicegui import ui

from printctl.web.errors import BadRequestError
from printctl.web.printer.layout import note, quiet_button
from printctl.web.printer.wizards import Wizard

Place = tuple[float, float, float]


class Sheet:
    """Rows of inputs, or of places that the tip was brought to.

    Parameters
    ----------
    wizard : Wizard
    place : function
        Gives where the tip is, mm; None where the printer hasn't told.
    """

    def __init__(self, wizard: Wizard, place: Callable[[], Place | None]) -> None:
        self._wizard, self._place = wizard, place
        self._cells: list[list[ui.input]] = []
        with ui.element("table").classes("pc-sheet"):
            with ui.element("thead"), ui.element("tr"):
                for column in wizard.columns:
                    with ui.element("th").props("scope=col"):
                        ui.label(column)
            self._body = ui.element("tbody")
        with ui.row().classes("gap-2 items-center"):
            if wizard.placed:
                self._word = ui.input(
                    wizard.columns[0].capitalize(),
                    value="bed" if wizard.name == "level" else "",
                ).props("outlined")
                quiet_button("Take where the tip is", self._take)
            else:
                quiet_button("Add a row", lambda: self._add([""] * len(wizard.columns)))
        if wizard.name == "level":
            note("Surface: bed (dry floor) or bath.")

    def fill(self, rows: Sequence[Sequence[str]]) -> None:
        """Begin anew with these rows."""
        self._body.clear()
        self._cells.clear()
        for row in rows:
            self._add(row)

    def rows(self) -> tuple[tuple[str, ...], ...]:
        """What stands in the table; rows whose last cell is empty weren't measured.

        Raises
        ------
        BadRequestError
            When nothing was measured.
        """
        every = (tuple(str(cell.value or "").strip() for cell in row) for row in self._cells)
        kept = tuple(row for row in every if row[-1])
        if not kept:
            raise BadRequestError(f"fill in the last column, {self._wizard.columns[-1]}")
        return kept

    def _take(self) -> None:
        place = self._place()
        if place is None:
            ui.notify("the printer hasn't told where its tip is; connect and home it first")
            return
        self._add([str(self._word.value or ""), *(f"{value:.3f}" for value in place)])

    def _add(self, row: Sequence[str]) -> None:
        number = len(self._cells) + 1
        cells = []
        with self._body, ui.element("tr"):
            for name, text in zip(self._wizard.columns, row, strict=True):
                with ui.element("td"):
                    cell = ui.input(value=text).props(
                        f'dense outlined aria-label="{name}, row {number}"'
                    )
                    cells.append(cell)
        self._cells.append(cells)
