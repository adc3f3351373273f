"""Write CSV tables of vessels, their sections, defects and geometric characteristics."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from design.files import write_text
from registration.measuring.judging import list_findings
from registration.result import RegistrationReport, report_dict

VESSELS, SECTIONS, DEFECTS = "vessels.csv", "sections.csv", "defects.csv"
ZONES = "characteristics.csv"

_SECTION_COLUMNS = {
    "along_mm": "along_mm",
    "diameter_um": "diameter_um",
    "area_mm2": "area_mm2",
    "ovality_along": "ovality",
    "offset_along_um": "offset_um",
    "noise_um": "noise_um",
    "designed_along_um": "designed_um",
    "interval_95_um": "interval_95_um",
    "lower_um": "lower_um",
    "upper_um": "upper_um",
    "decision_along": "decision",
}


def write_tables(folder: Path, report: RegistrationReport | Mapping[str, Any]) -> tuple[str, ...]:
    """Write vessels, sections, defects and characteristics as CSV; return the files' names.

    A number that isn't known is an empty field. Units stand in the columns' names. Beside what
    was gauged, a vessel's row has its resistance and flow as designed and as printed.

    Parameters
    ----------
    folder : Path
    report : RegistrationReport or mapping
        Or its numbers; decisions stand in the tables of judged ones (`judging.judge`).

    Raises
    ------
    OSError
        When a file can't be written.
    """
    numbers = report_dict(report) if isinstance(report, RegistrationReport) else report
    write_text(folder / VESSELS, as_csv(_rows(numbers)))
    write_text(
        folder / SECTIONS,
        as_csv(_sections(numbers["vessels"]), ("vessel", *_SECTION_COLUMNS.values())),
    )
    write_text(
        folder / DEFECTS, as_csv([_defect(d) for d in list_findings(numbers)], _DEFECT_COLUMNS)
    )
    rows = [_zone(row) for row in numbers.get("characteristics", ())]
    write_text(folder / ZONES, as_csv(rows, _ZONE_COLUMNS))
    return VESSELS, SECTIONS, DEFECTS, ZONES


def vessel_rows(report: RegistrationReport) -> list[dict[str, Any]]:
    """Every vessel's deviation, a row each, as `vessels.csv` holds it; None where not known.

    Among the columns are ``designed_um``, ``measured_um``, ``error_percent``, ``rms_um`` and
    ``open`` (`VesselGauge` says what each is), and resistance and flow as designed and as printed.
    """
    return _rows(report_dict(report))


def _rows(numbers: Mapping[str, Any]) -> list[dict[str, Any]]:
    vessels = numbers["vessels"]
    flow = numbers["perfusion"]["vessels"] if numbers["perfusion"] else [{}] * len(vessels)
    return [_scalars(vessel) | driven for vessel, driven in zip(vessels, flow, strict=True)]


_DEFECT_COLUMNS = (
    "kind", "vessel", "other", "from_mm", "to_mm", "at_mm", "x_mm", "y_mm", "z_mm", "size_um",
    "error_um", "percent", "wall_um", "significance", "seen", "doubt", "local", "decision",
    "deviation_um", "deviation_percent", "u_um", "lower_um", "upper_um",
)  # fmt: skip


_ZONE_COLUMNS = (
    "feature", "characteristic", "vessel", "zone_um", "low_um", "high_um", "limit_um", "decision",
    "seen_fraction", "note",
)  # fmt: skip


def as_csv(rows: Sequence[Mapping[str, Any]], columns: Iterable[str] | None = None) -> str:
    """Rows as CSV with a heading; the first row's keys are the columns unless they are given."""
    names = list(columns if columns is not None else rows[0] if rows else ())
    text = io.StringIO()
    table = csv.DictWriter(text, names, restval="", lineterminator="\n", extrasaction="raise")
    table.writeheader()
    table.writerows(
        {key: "" if value is None else value for key, value in row.items()} for row in rows
    )
    return text.getvalue()


def _scalars(vessel: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in vessel.items() if not isinstance(value, list)}


def _sections(vessels: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    return [
        {"vessel": vessel["vessel"], **dict(zip(_SECTION_COLUMNS.values(), row, strict=True))}
        for vessel in vessels
        for row in zip(*(_along(vessel, key) for key in _SECTION_COLUMNS), strict=True)
    ]


def _along(vessel: Mapping[str, Any], key: str) -> Sequence[Any]:
    """A list of the vessel's, or as many unknowns where nothing was judged."""
    values: Sequence[Any] = vessel.get(key) or [None] * len(vessel["along_mm"])
    return values


def _zone(row: Mapping[str, Any]) -> dict[str, Any]:
    low, high = row["interval_95_um"]
    plain = {**row, "low_um": low, "high_um": high}
    return {name: plain.get(name) for name in _ZONE_COLUMNS}


def _defect(defect: Mapping[str, Any]) -> dict[str, Any]:
    plain = dict(defect)
    plain["x_mm"], plain["y_mm"], plain["z_mm"] = plain.pop("point_mm")
    plain["lower_um"], plain["upper_um"] = plain.get("tolerance_um") or (None, None)
    return {name: plain.get(name) for name in _DEFECT_COLUMNS}
