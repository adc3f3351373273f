"""Read a periodic waveform from the time column and another of a user's CSV file."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from design.errors import FlowInputError
from design.hemodynamics.waveforms.waveform import Interpolation, Tabulated


def read_waveform(
    path: Path,
    column: str,
    scale: float = 1.0,
    period_s: float | None = None,
    interpolation: Interpolation = "linear",
) -> Tabulated:
    """Read the columns ``time_s`` and ``column``.

    Parameters
    ----------
    path : Path
    column : str
        Of the values; its name says their unit, such as ``flow_ml_min``.
    scale : float
        From that unit to ours.
    period_s, interpolation
        As of `Tabulated`.

    Raises
    ------
    FlowInputError
        A missing column, an empty or unreadable cell, samples that are no waveform.
    OSError
        When the file can't be read.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as handle:
            rows = list(csv.DictReader(handle))
    except (UnicodeDecodeError, csv.Error) as exc:
        raise FlowInputError(f"{path} isn't a CSV file: {exc}") from exc
    for name in ("time_s", column):
        if not rows or name not in rows[0]:
            raise FlowInputError(
                f"{path} has no column {name}; its first line names time_s,{column}"
            )
    time = [_cell(path, k, row["time_s"]) for k, row in enumerate(rows, 2)]
    value = [_cell(path, k, row[column]) for k, row in enumerate(rows, 2)]
    try:
        return Tabulated(np.array(time), scale * np.array(value), period_s, interpolation)
    except FlowInputError as exc:
        raise FlowInputError(f"{path}: {exc}") from exc


def _cell(path: Path, line: int, text: str | None) -> float:
    try:
        return float(text or "")
    except ValueError as exc:
        raise FlowInputError(
            f"{path}, line {line}: {text!r} is no number; fill the missing sample in, or leave "
            "the line out"
        ) from exc
