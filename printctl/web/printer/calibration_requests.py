"""Request types of the calibration service: options and readings."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

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


class CalibrationFiles(BaseModel):
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
