"""Cards of calibration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from nicegui import ui

from firmware_profiles import Syringe
from printctl.machine.station import StationStatus
from printctl.web.controls import Principal
from printctl.web.errors import BadRequestError
from printctl.web.printer.calibration_requests import CalibrationRequest, Read, Wizard
from printctl.web.printer.layout import (
    Refresh,
    button,
    card,
    dialog,
    live,
    note,
    number,
    quiet_button,
    subheading,
)
from printctl.web.printer.service import PrinterService
from printctl.web.shell.frame import run_or_notify

if TYPE_CHECKING:
    from printctl.calibration.results import Result


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


# Calibration dialog: write the test, enter readings, show the result, save a profile copy.


def wizard_dialog(service: PrinterService, who: Principal, wizard: Wizard) -> Callable[[], None]:
    """Give what opens the dialog; it is made when it is first opened."""
    made: list[_Dialog] = []

    def show() -> None:
        if not made:
            made.append(_Dialog(service, who, wizard))
        made[0].show()

    return show


class _Dialog:
    """One calibration's dialog."""

    def __init__(self, service: PrinterService, who: Principal, wizard: Wizard) -> None:
        self._service, self._who, self._wizard = service, who, wizard
        with dialog(wizard.title, wide=True, beside=wizard.placed) as self._dialog:
            note(f"Needs {wizard.needs}.")
            store = service.store
            self._printer = ui.select(store.printers(), label="Printer profile")
            self._syringe = ui.select(store.names(Syringe), label="Syringe")
            for one in (self._printer, self._syringe):
                one.classes("w-full").set_visibility(wizard.printed)
            if wizard.printed:
                button("Make the test's G-code", self._make)
                self._job = live()
            self._sheet = Sheet(wizard, lambda: service.status.position_mm)
            self._density: ui.number | None = None
            if wizard.name == "weigh":
                self._density = number("Density", 0.998, 0.1, 20, 0.001, "g/cm³")
            with ui.row().classes("gap-2"):
                button("What do they say?", self._fit)
                quiet_button("Close", self._dialog.close)
            self._result = ui.column().classes("w-full gap-1").props("role=status")

    def show(self) -> None:
        """Open it, with what is connected chosen."""
        store, status = self._service.store, self._service.status
        profile = store.name(status.profile) if status.profile else "generic_marlin"
        syringe = store.name(status.mounted.syringe) if status.mounted.syringe else ""
        self._printer.set_value(profile)
        self._syringe.set_value(syringe or "hamilton_1ml")
        self._dialog.open()

    async def _make(self) -> None:
        made = await run_or_notify(self._prepare)
        if made is None:
            return
        start = ", ".join(f"{value:.2f}" for value in made.start_mm)
        self._job.set_text(
            f"{made.job}: {made.lines} lines, {made.duration_s:.0f} s, from X, Y, Z {start} mm. "
            "Print it by the Job page, then fill in the last column."
        )
        self._sheet.fill(made.rows)

    def _prepare(self) -> Any:
        place = self._service.status.position_mm
        if place is None:
            raise BadRequestError("connect the printer and bring the tip to where the test begins")
        asked = CalibrationRequest(
            printer=str(self._printer.value), syringe=str(self._syringe.value), at_mm=place
        )
        return self._service.calibrating.make(self._who, self._wizard.name, asked)

    def _read(self) -> Read:
        values: dict[str, Any] = {"rows": self._sheet.rows()}
        if self._density is not None:
            values["density_g_cm3"] = float(self._density.value or 0.998)
        return Read(printer=str(self._printer.value), syringe=str(self._syringe.value), **values)

    async def _fit(self) -> None:
        result = await run_or_notify(
            lambda: self._service.calibrating.fit(self._wizard.name, self._read())
        )
        self._result.clear()
        if result is not None:
            with self._result:
                self._tell(result)

    def _tell(self, result: Result) -> None:
        with ui.element("dl").classes("pc-facts"):
            for name, estimate in result.lines.items():
                with ui.element("dt"):
                    ui.label(name)
                with ui.element("dd"):
                    ui.label(estimate.text())
        note("95 % intervals")
        for text in result.notes:
            note(text)
        if self._wizard.writes:
            self._offer_copy()

    def _offer_copy(self) -> None:
        subheading("Write it into a copy of a profile")
        mends = {
            "printer": f"steps/mm of {self._printer.value}, where the bore is right",
            "syringe": f"bore of {self._syringe.value}, where the steps are right",
        }
        mend = ui.select(mends, label="What is measured", value="printer").classes("w-full")
        name = ui.input("Name of the copy", value=f"{self._printer.value}_measured")
        name.classes("w-full").props("outlined")
        mend.on_value_change(
            lambda: name.set_value(
                f"{(self._printer if mend.value == 'printer' else self._syringe).value}_measured"
            )
        )
        copy_line = live()

        async def save() -> None:
            done = await run_or_notify(
                lambda: self._service.calibrating.save(
                    self._who, self._read(), mend.value, str(name.value)
                )
            )
            if done is not None:
                copy_line.set_text(f"written: {done}. Choose it under Connection from now on.")

        button("Write the copy", save)


def add_calibrating(service: PrinterService, who: Principal) -> Refresh:
    """A row for each calibration."""
    with card("Calibration"):
        note("The same tests and fits as `printctl calibrate`; every number with its interval.")
        with ui.element("ul").classes("pc-list"):
            for wizard in service.calibrating.wizards:
                with ui.element("li"):
                    with ui.column().classes("gap-0 grow"):
                        ui.label(wizard.title).classes("font-semibold")
                        note(f"Needs {wizard.needs}; gives {wizard.gives}.")
                    if wizard.columns:
                        show = wizard_dialog(service, who, wizard)
                        quiet_button("Start …", show).props(f'aria-label="Start: {wizard.title}"')
                    else:
                        note(f"printctl calibrate {wizard.name}").classes("font-mono")

    def refresh(status: StationStatus) -> None:
        """Nothing here changes with the printer."""

    return refresh
