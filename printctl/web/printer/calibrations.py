"""Calibrations that the Printer page offers: their sheets, and what is sent for each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

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
