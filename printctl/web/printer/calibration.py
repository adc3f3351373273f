"""Calibrations of the Printer page: table, requests, test files, fits."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from design.files import write_text
from firmware_profiles import Printer, Syringe
from printctl.calibration.readings import Readings, read_readings
from printctl.errors import PrintctlError
from printctl.web.controls import Principal
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.printer.printer_commands import PrinterAccess
from printctl.web.profile_store import ProfileStore

if TYPE_CHECKING:
    from printctl.calibration.results import Result

Mend = Literal["printer", "syringe"]


@dataclass(frozen=True)
class Wizard:
    """One calibration.

    Attributes
    ----------
    name : str
        As `printctl calibrate NAME`.
    title, needs, gives : str
    columns : tuple of str
        Of its sheet, the words first; empty for one that is done by the command line alone.
    words : int
        How many of the columns are words.
    printed : bool
        Whether it begins with a test that is printed.
    placed : bool
        Whether a row takes the tip's place.
    writes : tuple of str
        What a measured copy of a profile can be written of.
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

    @property
    def numbers(self) -> tuple[str, ...]:
        """Columns of numbers."""
        return self.columns[self.words :]


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
_MM = Annotated[float, Field(ge=-1000, le=1000)]
_Doses = Annotated[
    tuple[Annotated[float, Field(gt=0, le=10_000)], ...], Field(min_length=1, max_length=20)
]
_Targets = Annotated[tuple[_MM, ...], Field(min_length=1, max_length=20)]
_Cell = Annotated[str, Field(pattern=r"^[A-Za-z0-9 _.+-]{0,24}$")]


class CalibrationRequest(BaseModel):
    """What a test is made with; defaults are the command line's."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    printer: str = Field(description="Profile.")
    syringe: str = "hamilton_1ml"
    at_mm: tuple[_MM, _MM, _MM] = Field(description="Where the tip stands, mm.")
    doses_ul: _Doses = (20.0, 40.0, 60.0)
    repeats: Annotated[int, Field(ge=1, le=20)] = 4
    flow_ul_s: Annotated[float, Field(ge=0.001, le=1000)] = 2.0
    wait_s: Annotated[float, Field(ge=0, le=600)] = 30.0
    axis: Literal["x", "y", "z", "e"] = "x"
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


@dataclass(frozen=True)
class CalibrationFiles:
    """Written calibration test.

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
