"""Calibrations on the page: the same tests, fits and files as `printctl calibrate`."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from design.files import write_text
from firmware_profiles import Printer, Syringe
from printctl.calibration import Readings, backlash_path, read_readings, weighing_path
from printctl.calibration.paths import Axis
from printctl.calibration.results import (
    Result,
    backlash_result,
    level_result,
    offset_result,
    weighing_of,
    weighing_result,
)
from printctl.calibration.writing import Job, Made, make_test, measured_key, save_measured
from printctl.errors import PrintctlError
from printctl.web.controls import Principal
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.printer.desk import Desk
from printctl.web.printer.shelf import Shelf
from printctl.web.printer.wizards import BY_NAME, WIZARDS, Wizard

MOST_ROWS: Final = 200
LARGEST: Final = 1e6
_MM = Annotated[float, Field(ge=-1000, le=1000)]
_Doses = Annotated[
    tuple[Annotated[float, Field(gt=0, le=10_000)], ...], Field(min_length=1, max_length=20)
]
_Targets = Annotated[tuple[_MM, ...], Field(min_length=1, max_length=20)]
_Cell = Annotated[str, Field(pattern=r"^[A-Za-z0-9 _.+-]{0,24}$")]


class Asked(BaseModel):
    """What a test is made with; defaults are the command line's."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    printer: str = Field(description="Profile.")
    syringe: str = "hamilton_1ml"
    at_mm: tuple[_MM, _MM, _MM] = Field(description="Where the tip stands, mm.")
    doses_ul: _Doses = (20.0, 40.0, 60.0)
    repeats: Annotated[int, Field(ge=1, le=20)] = 4
    flow_ul_s: Annotated[float, Field(ge=0.001, le=1000)] = 2.0
    wait_s: Annotated[float, Field(ge=0, le=600)] = 30.0
    axis: Axis = "x"
    targets_mm: _Targets = (2.0, 4.0, 6.0, 8.0, 10.0)
    overshoot_mm: Annotated[float, Field(ge=0.01, le=20)] = 1.0
    speed_mm_s: Annotated[float, Field(ge=0.01, le=100)] = 2.0


class Read(BaseModel):
    """What was read of a test, as text of the sheet; empty last columns are left out."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    rows: Annotated[tuple[tuple[_Cell, ...], ...], Field(min_length=1, max_length=MOST_ROWS)]
    printer: str = "generic_marlin"
    syringe: str = "hamilton_1ml"
    density_g_cm3: Annotated[float, Field(gt=0.1, le=20)] = 0.998
    density_error: Annotated[float, Field(ge=0, le=5)] = 0.001
    part_mm: tuple[_MM, _MM] = (20.0, 20.0)


class Prepared(BaseModel):
    """A test that was made.

    Attributes
    ----------
    job : str
        As the Job page names it.
    """

    job: str
    lines: int
    duration_s: float
    notes: tuple[str, ...]
    start_mm: tuple[float, float, float]
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


class Calibrating:
    """Makes tests, reads what was measured, writes measured copies of profiles.

    Parameters
    ----------
    desk : Desk
    shelf : Shelf
    """

    def __init__(self, desk: Desk, shelf: Shelf) -> None:
        self._desk, self._shelf = desk, shelf

    @property
    def wizards(self) -> tuple[Wizard, ...]:
        """All there are."""
        return WIZARDS

    def make(self, who: Principal, name: str, asked: Asked) -> Prepared:
        """Write a test into the workspace's jobs, with its sheet beside it.

        Raises
        ------
        NotFoundError, ConflictError
        SafetyError
            When preflight refuses it.
        """
        self._desk.core.controls.require(who)
        wizard = _on_page(name)
        if not wizard.printed:
            raise ConflictError(f"{wizard.title} has no test to print; enter readings at once")
        printer = self._shelf.load(Printer, asked.printer)
        if printer.pneumatic:
            raise ConflictError(
                f"{printer.name} has a pneumatic head; weigh its flow by the command line: "
                "printctl calibrate weigh"
            )
        syringe = self._shelf.load(Syringe, asked.syringe)
        stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
        path = self._desk.core.workspace.root / "jobs" / f"calibrate_{name}_{stamp}.gcode"
        rows, made = _written(name, asked, printer, syringe, path)
        return Prepared(
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
        if name == "weigh":
            found = weighing_of(data, read.density_g_cm3, read.density_error)
            printer = self._shelf.load(Printer, read.printer)
            return weighing_result(found, printer, self._shelf.load(Syringe, read.syringe))
        if name == "level":
            return level_result(data, *read.part_mm)
        return offset_result(data) if name == "offset" else backlash_result(data)

    def save(
        self, who: Principal, read: Read, mend: Literal["printer", "syringe"], copy: str
    ) -> str:
        """Write what was weighed into a copy of a profile in the workspace; say what changed.

        Raises
        ------
        ConflictError
            When a shipped profile has the copy's name.
        UsageError
        """
        self._desk.core.controls.require(who)
        data = self._readings(BY_NAME["weigh"], read.rows)
        found = weighing_of(data, read.density_g_cm3, read.density_error)
        printer = self._shelf.load(Printer, read.printer)
        syringe = self._shelf.load(Syringe, read.syringe)
        if mend == "printer":
            measured = measured_key(printer, "steps_per_mm.e", found.steps_per_mm(printer, syringe))
            return save_measured(self._shelf.new_file(Printer, copy), printer, measured)
        measured = measured_key(syringe, "inner_mm", found.bore_mm())
        return save_measured(self._shelf.new_file(Syringe, copy), syringe, measured)

    def _readings(self, wizard: Wizard, rows: Sequence[Sequence[str]]) -> Readings:
        """Readings by way of a file like the command line's; it stays as a record."""
        width = len(wizard.columns)
        if any(len(row) != width for row in rows):
            raise BadRequestError(
                f"each row has {width} columns: {', '.join(wizard.columns)}; fill in or leave out"
            )
        table = io.StringIO()
        csv.writer(table, lineterminator="\n").writerows([wizard.columns, *rows])
        folder = self._desk.core.workspace.root / "records" / "calibrations"
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


def _written(
    name: str, asked: Asked, printer: Printer, syringe: Syringe, path: Path
) -> tuple[list[list[str]], Made]:
    """Write the test; give the sheet's rows, their last column to be filled in."""
    columns = BY_NAME[name].columns
    if name == "weigh":
        doses = list(asked.doses_ul) * asked.repeats
        per_ul = 4 / (math.pi * syringe.inner_mm**2)
        rows = [[f"{dose * per_ul:.5f}", ""] for dose in doses]
        toolpath = weighing_path(doses, asked.flow_ul_s, asked.wait_s)
    else:
        toolpath, places, sides = backlash_path(
            asked.axis,
            list(asked.targets_mm),
            overshoot_mm=asked.overshoot_mm,
            speed_mm_s=asked.speed_mm_s,
            wait_s=min(asked.wait_s, 8.0),
            syringe=syringe,
        )
        rows = [[f"{p:g}", f"{s:g}", ""] for p, s in zip(places, sides, strict=True)]
    job = Job(path, toolpath, printer, syringe, asked.at_mm)
    return rows, make_test(job, columns, rows, {})
