"""Calibration dialog: write the test, enter readings, show the result, save a profile copy."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from nicegui import ui

from firmware_profiles import Syringe
from printctl.web.controls import Principal
from printctl.web.errors import BadRequestError
from printctl.web.printer.calibration_requests import CalibrationRequest, Read
from printctl.web.printer.layout import button, dialog, live, note, number, quiet_button, subheading
from printctl.web.printer.service import PrinterService
from printctl.web.printer.sheet import Sheet
from printctl.web.printer.wizards import Wizard
from printctl.web.shell.run_or_notify import run_or_notify

if TYPE_CHECKING:
    from printctl.calibration.results import Result


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
