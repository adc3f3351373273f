"""Calibrations of the Printer page: test files, readings, fits, measured copies of profiles."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Final

from design.files import write_text
from firmware_profiles import Printer, Syringe
from printctl.calibration.readings import Readings, read_readings
from printctl.errors import PrintctlError
from printctl.web.controls import Principal
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.printer.calibrations import (
    BY_NAME,
    WIZARDS,
    CalibrationFiles,
    CalibrationRequest,
    Mend,
    Read,
    Wizard,
)
from printctl.web.printer.printer_commands import PrinterAccess
from printctl.web.profile_store import ProfileStore

if TYPE_CHECKING:
    from printctl.calibration.results import Result

LARGEST: Final = 1e6


class Calibrating:
    """Makes tests, reads what was measured, writes measured copies of profiles.

    Parameters
    ----------
    access : PrinterAccess
    store : ProfileStore
    """

    def __init__(self, access: PrinterAccess, store: ProfileStore) -> None:
        self._access, self._store = access, store

    @property
    def wizards(self) -> tuple[Wizard, ...]:
        """All there are."""
        return WIZARDS

    def make(self, who: Principal, name: str, asked: CalibrationRequest) -> CalibrationFiles:
        """Write a test into the workspace's jobs, with its sheet beside it.

        Raises
        ------
        NotFoundError, ConflictError
        SafetyError
            When preflight refuses it.
        """
        self._access.core.controls.require(who)
        wizard = _on_page(name)
        if not wizard.printed:
            raise ConflictError(f"{wizard.title} has no test to print; enter readings at once")
        printer = self._store.load(Printer, asked.printer)
        if printer.pneumatic:
            raise ConflictError(
                f"{printer.name} has a pneumatic head; weigh its flow by the command line: "
                "printctl calibrate weigh"
            )
        syringe = self._store.load(Syringe, asked.syringe)
        stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
        path = self._access.core.workspace.root / "jobs" / f"calibrate_{name}_{stamp}.gcode"
        from printctl.web.printer.calibration_work import write_test  # loads scipy

        rows, made = write_test(name, asked, printer, syringe, path)
        return CalibrationFiles(
            job=f"file~{path.name}",
            lines=made.lines,
            duration_s=made.duration_s,
            notes=made.notes,
            start_mm=asked.at_mm,
            columns=wizard.columns,
            rows=tuple(map(tuple, rows)),
        )

    def fit(self, name: str, read: Read) -> Result:
        """What the readings say.

        Raises
        ------
        NotFoundError, UsageError
        """
        wizard = _on_page(name)
        data = self._readings(wizard, read.rows)
        from printctl.web.printer.calibration_work import fit_readings  # loads scipy

        return fit_readings(name, data, read, self._store)

    def save(self, who: Principal, read: Read, mend: Mend, copy_name: str) -> str:
        """Write what was weighed into a copy of a profile in the workspace; say what changed.

        Raises
        ------
        ConflictError
            When a shipped profile has the copy's name.
        UsageError
        """
        self._access.core.controls.require(who)
        data = self._readings(BY_NAME["weigh"], read.rows)
        from printctl.web.printer.calibration_work import write_profile_copy  # loads scipy

        return write_profile_copy(data, read, mend, copy_name, self._store)

    def _readings(self, wizard: Wizard, rows: Sequence[Sequence[str]]) -> Readings:
        """Readings by way of a file like the command line's; it stays as a record."""
        width = len(wizard.columns)
        if any(len(row) != width for row in rows):
            raise BadRequestError(
                f"each row has {width} columns: {', '.join(wizard.columns)}; fill in or leave out"
            )
        table = io.StringIO()
        csv.writer(table, lineterminator="\n").writerows([wizard.columns, *rows])
        folder = self._access.core.workspace.root / "records" / "calibrations"
        path = folder / f"{wizard.name}_{datetime.now():%Y%m%d}.csv"
        write_text(path, table.getvalue())
        try:
            data = read_readings(path, wizard.numbers, wizard.columns[: wizard.words])
        except PrintctlError as exc:
            raise BadRequestError(str(exc).replace(f"{path}", "the readings")) from exc
        largest = max(float(abs(column).max()) for column in data.numbers.values())
        if largest > LARGEST:
            raise BadRequestError(f"a reading of {largest:g}: at most {LARGEST:g}; mend the row")
        return data


def _on_page(name: str) -> Wizard:
    wizard = BY_NAME.get(name)
    if wizard is None:
        raise NotFoundError(f"there is no calibration {name[:40]!r}; {', '.join(BY_NAME)}")
    if not wizard.columns:
        raise ConflictError(f"it is done by the command line: printctl calibrate {name} --help")
    return wizard
