"""Write the HTML page of a well plate job: plate picture, wells, results of scanned wells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from design.files import write_text
from firmware_profiles import Plate
from registration.report.page_frame import render
from registration.report.plate_figure import plate_figure
from registration.report.sections import check_table, mapping, records, timing_rows
from registration.report.svg import inline_figure
from registration.report.tables import Column, Table, make_table

_WELL: Final = (
    Column("well", "Well", kind="text"),
    Column("variant", "Variant"),
)
_DONE: Final = (
    Column("ink_ul", "Ink", "µL"),
    Column("begins_s", "Begins", "s"),
    Column("lasts_s", "Lasts", "s"),
    Column("x_mm", "x", "mm"),
    Column("y_mm", "y", "mm"),
    Column("first_line", "From line"),
    Column("last_line", "To line"),
)
_SCANNED: Final = (
    Column("outcome", "Scan", kind="text"),
    Column("rms_um", "RMS, scaled", "µm"),
    Column("mean_error_percent", "Diameters, mean error", "%", kind="signed"),
    Column("worst_error_percent", "worst", "%", kind="signed"),
)


def write_plate_html(path: Path, data: Mapping[str, Any], plate: Plate) -> None:
    """Write the page as one HTML file that opens offline.

    Parameters
    ----------
    path : Path
        The file; an old one is replaced only by a whole new one.
    data : dict
        What the plate's report.json holds.
    plate : Plate

    Raises
    ------
    OSError
        When the file can't be written.
    """
    wells = records(data, "wells")
    context = {
        "data": data,
        "picture": inline_figure(plate_figure(plate, wells), f"{plate.name}, from above", "p-"),
        "well_table": well_table(wells),
        "check_table": check_table(mapping(data, "dry_run")),
        "timing_rows": timing_rows(mapping(data, "timings")),
        "variants": _variants(wells),
    }
    write_text(path, render("plate.html", context))


def well_table(wells: Sequence[Mapping[str, Any]]) -> Table:
    """A row for each well in the printing order, swept keys as columns of their own."""
    keys = list(dict.fromkeys(key for row in wells for key in row["values"]))
    swept = tuple(
        Column(f"v{k}", key, kind=_kind([row["values"].get(key) for row in wells]))
        for k, key in enumerate(keys)
    )
    rows = [
        {**row, **{f"v{k}": row["values"].get(key) for k, key in enumerate(keys)}} for row in wells
    ]
    columns = (*_WELL, *swept, Column("copy", "Copy"), *_SCANNED, *_DONE)
    return make_table("wells", rows, columns, order="as printed")


def _kind(values: Sequence[Any]) -> Any:
    numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    return "number" if numbers else "text"


def _variants(wells: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Number, label and wells of each variant."""
    variants: dict[int, dict[str, Any]] = {}
    for row in sorted(wells, key=lambda row: (row["variant"], row["copy"])):
        text = row["label"] if row["values"] else "as the recipe says"
        one = variants.setdefault(
            row["variant"], {"label": text, "wells": [], "number": row["variant"]}
        )
        one["wells"].append(row["well"])
    return list(variants.values())
