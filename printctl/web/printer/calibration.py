"""Calibrations of the Printer page: test files, readings, fits, measured copies of profiles."""

from __future__ import annotations

import csv
import io
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Annotated, Any, Final, Literal

from pydantic import ConfigDict, Field

from design.files import write_text
from firmware_profiles import Printer, Syringe
from printctl import calibration
from printctl.checks.made_for import header_lines, read_made_for
from printctl.errors import PrintctlError
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.printer.part_change import Name, NameOrNone
from printctl.web.printer.service import PrinterService
from printctl.web.rest import Asking, Body

Mend = Literal["printer", "syringe"]
LARGEST: Final = 1e6


@dataclass(frozen=True)
class Wizard:
    """One calibration, as `printctl calibrate NAME`.

    Its sheet's ``columns`` begin with so many ``words``; none for one that is done by the command
    line alone. ``printed`` is whether it begins with a test that is printed, ``placed`` whether a
    row takes the tip's place; a measured copy of a profile can be written of ``writes``.
    """

    name: str
    title: str
    needs: str
    gives: str
    columns: tuple[str, ...] = ()
    words: int = 0
    printed: bool = False
    placed: bool = False
    writes: tuple[Mend, ...] = ()


WIZARDS: Final[tuple[Wizard, ...]] = (
    Wizard(
        "weigh",
        "Flow by weight",
        "a balance, covered vials, water or ink of known density, a primed needle above the vial",
        "volume per plunger travel, steps per µL",
        ("travel_mm", "mass_mg"),
        printed=True,
        writes=("printer", "syringe"),
    ),
    Wizard(
        "level",
        "Level of bed and bath",
        "a needle; four or more points, not on one line, on the dry bed and on the bath",
        "slopes, flatness, depth of the bath",
        ("surface", "x_mm", "y_mm", "z_mm"),
        words=1,
        placed=True,
    ),
    Wizard(
        "offset",
        "Offset between two needles",
        "both needles and one mark that each touches at least twice, better five times",
        "offset in x, y and z",
        ("needle", "x_mm", "y_mm", "z_mm"),
        words=1,
        placed=True,
    ),
    Wizard(
        "backlash",
        "Lost motion of an axis",
        "a dial gauge that touches the axis (or the plunger)",
        "lost motion where the axis turns round, its scale",
        ("target_mm", "approach", "measured_mm"),
        printed=True,
    ),
    Wizard("lag", "Pressure lag and flow factor", "a printed line and a microscope", "τ, K"),
    Wizard(
        "pattern",
        "Calibration prints",
        "ink, needle and bath as they will be used",
        "lines, spiral, joints, bridges and a comb of gaps, read by widths",
    ),
    Wizard("widths", "Widths of a calibration print", "a picture or widths", "ink's constants"),
    Wizard("walls", "Offset of scanned walls", "scans of channels of known width", "the offset"),
    Wizard("oct", "Scanner", "scans of a grid and of a step", "the scanner's distortion"),
)
BY_NAME: Final = {wizard.name: wizard for wizard in WIZARDS}
MOST_ROWS: Final = 200
MM = Annotated[float, Field(ge=-1000, le=1000)]
_Doses = Annotated[
    tuple[Annotated[float, Field(gt=0, le=10_000)], ...], Field(min_length=1, max_length=20)
]
_Targets = Annotated[tuple[MM, ...], Field(min_length=1, max_length=20)]
_Cell = Annotated[str, Field(pattern=r"^[A-Za-z0-9 _.+-]{0,24}$")]


class CalibrationRequest(Body):
    """What a test is made with; defaults are the command line's."""

    model_config = ConfigDict(frozen=True)

    printer: Name = Field(description="Profile.")
    syringe: Name = Field(description="Profile.")
    at_mm: tuple[MM, MM, MM] = Field(description="Where the tip stands, mm.")
    doses_ul: _Doses = (20.0, 40.0, 60.0)
    repeats: Annotated[int, Field(ge=1, le=20)] = 4
    flow_ul_s: Annotated[float, Field(ge=0.001, le=1000)] = 2.0
    wait_s: Annotated[float, Field(ge=0, le=600)] = 30.0
    axis: Literal["x", "y", "z", "e"] = "x"
    targets_mm: _Targets = (2.0, 4.0, 6.0, 8.0, 10.0)
    overshoot_mm: Annotated[float, Field(ge=0.01, le=20)] = 1.0
    speed_mm_s: Annotated[float, Field(ge=0.01, le=100)] = 2.0


class Read(Body):
    """What was read of a test, as text of the sheet; empty last columns are left out."""

    model_config = ConfigDict(frozen=True)

    rows: Annotated[tuple[tuple[_Cell, ...], ...], Field(min_length=1, max_length=MOST_ROWS)]
    printer: NameOrNone = ""
    syringe: NameOrNone = ""
    job: str = Field(default="", description="The test's, whose set-up it was made with.")
    density_g_cm3: Annotated[float, Field(gt=0.1, le=20)] = 0.998
    density_error: Annotated[float, Field(ge=0, le=5)] = 0.001
    part_mm: tuple[MM, MM] = (20.0, 20.0)


class Save(Body):
    """A measured copy of a profile: what of, and its name."""

    read: Read
    mend: Mend
    copy_name: Name
    accept_change: bool = Field(default=False, description="Although it changes by over 20 %.")


@dataclass(frozen=True)
class CalibrationFiles:
    """Written calibration test; ``job`` is as the Job page names it."""

    job: str
    lines: int
    duration_s: float
    notes: tuple[str, ...]
    start_mm: tuple[float, float, float]
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


class Calibrating:
    """Makes tests, fits what was measured, writes measured copies of profiles.

    Its methods are routes.
    """

    def __init__(self, service: PrinterService) -> None:
        self._core, self._store = service.core, service.store

    def make(self, name: str, body: CalibrationRequest, who: Asking) -> CalibrationFiles:
        """Write a test into the workspace's jobs, with its sheet beside it."""
        self._core.controls.require(who)
        wizard = _on_page(name)
        if not wizard.printed:
            raise ConflictError(f"{wizard.title} has no test to print; enter readings at once")
        printer = self._store.load(Printer, body.printer)
        if printer.pneumatic:
            raise ConflictError(
                f"{printer.name} has a pneumatic head; weigh its flow by the command line: "
                "printctl calibrate weigh"
            )
        syringe = self._store.load(Syringe, body.syringe)
        if name == "weigh":
            doses = body.doses_ul * body.repeats
            test = calibration.weighing_test(doses, body.flow_ul_s, body.wait_s, syringe)
        else:
            test = calibration.backlash_test(
                body.axis,
                body.targets_mm,
                overshoot_mm=body.overshoot_mm,
                speed_mm_s=body.speed_mm_s,
                wait_s=min(body.wait_s, 8.0),
                syringe=syringe,
            )
        stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
        path = self._core.workspace.root / "jobs" / f"calibrate_{name}_{stamp}.gcode"
        made = calibration.make_test(calibration.Job(path, test, printer, syringe, body.at_mm))
        return CalibrationFiles(
            **asdict(made),
            job=f"file~{path.name}",
            start_mm=body.at_mm,
            columns=wizard.columns,
            rows=tuple((*row, "") for row in test.rows),
        )

    def fit(self, name: str, body: Read) -> dict[str, Any]:
        """Fit readings: ``estimates`` by name, each a value with its interval, and ``notes``."""
        data = self._readings(_on_page(name), body)
        if name == "weigh":
            result = self._weighed(data, body)
        elif name == "level":
            result = calibration.level_result(data, *body.part_mm)
        elif name == "offset":
            result = calibration.offset_result(data)
        else:
            result = calibration.backlash_result(data)
        estimates = {key: asdict(one) for key, one in result.lines.items()}
        return {"estimates": estimates, "notes": result.notes}

    def save(self, body: Save, who: Asking) -> dict[Literal["message"], str]:
        """Write what was weighed into a copy of a profile in the workspace; say what changed."""
        self._core.controls.require(who)
        data = self._readings(BY_NAME["weigh"], body.read)
        weighed = self._weighed(data, body.read, "steps" if body.mend == "printer" else "bore")
        kind = Printer if body.mend == "printer" else Syringe
        path = self._store.new_file(kind, body.copy_name)
        return {"message": weighed.save(path, accept_change=body.accept_change)}

    def _weighed(
        self, data: calibration.Readings, read: Read, mend: Literal["bore", "steps"] = "steps"
    ) -> calibration.Result:
        if not (read.printer and read.syringe):
            raise BadRequestError("choose the printer and the syringe that the test was made with")
        density = (read.density_g_cm3, read.density_error)
        printer = self._store.load(Printer, read.printer)
        syringe = self._store.load(Syringe, read.syringe)
        return calibration.weighing_result(data, density, printer, syringe, mend)

    def _readings(self, wizard: Wizard, read: Read) -> calibration.Readings:
        """Readings by way of a file like the command line's; it stays as a record."""
        columns = wizard.columns
        if any(len(row) != len(columns) for row in read.rows):
            raise BadRequestError(
                f"each row has {len(columns)} columns: {', '.join(columns)}; fill in or leave out"
            )
        table = io.StringIO()
        if read.job:
            test = self._core.workspace.job_file(read.job).read_bytes()
            table.writelines(f"# {line}\n" for line in header_lines(read_made_for(test[:4096])))
        csv.writer(table, lineterminator="\n").writerows([columns, *read.rows])
        folder = self._core.workspace.root / "records" / "calibrations"
        path = folder / f"{wizard.name}_{datetime.now():%Y%m%d}.csv"
        write_text(path, table.getvalue())
        try:
            data = calibration.read_readings(path, columns[wizard.words :], columns[: wizard.words])
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
