"""Write predicted ink as CSV tables: by piece or line, by vessel, and by layer."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np

from design.files import write_text
from printctl.checks.bead.layers import layer_rows
from printctl.checks.bead.predict import InkPrediction
from printctl.checks.bead.vessels import VesselDiameters

BEAD = (
    "head", "line", "source", "kind", "time_s", "lasts_s", "x_mm", "y_mm", "z_mm", "length_mm",
    "plunger_ul_s", "flow_ul_s", "laid_ul", "width_mm", "pressure_kpa",
)  # fmt: skip
VESSELS = (
    "head", "vessel", "written_mm", "designed_mm", "predicted_mm", "median_percent",
    "worst_percent", "worst_at_mm", "worst_line", "within_5_percent", "worst_percent_without_lag",
)  # fmt: skip
LAYERS = (
    "head", "layer", "laid_ul", "asked_ul", "width_mm", "narrow_mm", "wide_mm", "asked_width_mm",
)  # fmt: skip


def write_bead_csv(path: Path, all_heads: list[InkPrediction]) -> None:
    """A row a piece of an embedded print; in layers, of which there are many, a row a line.

    `kind` is writes, travels or stands; x, y, z is where the piece ends.
    """
    text = _begun(BEAD)
    for prediction in all_heads:
        _rows(text, prediction)
    write_text(path, text.getvalue())


def _rows(text: io.StringIO, prediction: InkPrediction) -> None:
    bead, pieces = prediction.bead, prediction.bead.pieces
    first = np.arange(len(bead))
    if bead.style == "layered":
        changes = (np.diff(bead.line) != 0) | (np.diff(bead.writes.astype(int)) != 0)
        first = np.flatnonzero(np.concatenate([[True], changes]))
    last = np.append(first[1:], len(bead)) - 1

    def total(values: np.ndarray) -> np.ndarray:
        return np.add.reduceat(values, first)

    lasts, length = total(pieces.duration), total(pieces.length)
    per_s = np.divide(1.0, lasts, out=np.zeros(len(lasts)), where=lasts > 0)
    laid = total(bead.flow.laid_ul)
    wide = total(bead.width_mm * pieces.length) / np.maximum(length, 1e-12)
    kind = np.where(bead.writes[first], "writes", np.where(length > 1e-9, "travels", "stands"))
    pressure = np.maximum.reduceat(bead.pressure_pa, first) * 1e-3
    columns = (
        pieces.time[first], lasts, *pieces.end[last].T, length,
        total(pieces.push_ul + pieces.jump_ul) * per_s, total(bead.flow.out_ul) * per_s,
        laid, np.where(length > 1e-9, wide, 0.0), pressure,
    )  # fmt: skip
    table = np.column_stack(columns)
    writer = csv.writer(text, lineterminator="\n")
    for k, row in enumerate(table.tolist()):
        at = first[k]
        writer.writerow(
            [prediction.head, bead.line[at], prediction.source[at], kind[k], *map(_number, row)]
        )


def write_vessels_csv(
    path: Path, heads: list[tuple[int, VesselDiameters, VesselDiameters | None]]
) -> None:
    """A row for each vessel, with the worst deviation that a plunger without lag would leave."""
    text = _begun(VESSELS)
    writer = csv.writer(text, lineterminator="\n")
    for head, own, prompt in heads:
        without = (
            {} if prompt is None else dict(zip(prompt.vessel.tolist(), prompt.worst, strict=True))
        )
        for k, vessel in enumerate(own.vessel.tolist()):
            worst = without.get(vessel)
            numbers = (
                own.written_mm[k], own.designed_mm[k], own.predicted_mm[k], 100 * own.median[k],
                100 * own.worst[k], own.worst_at_mm[k],
            )  # fmt: skip
            writer.writerow(
                [
                    head, vessel, *map(_number, numbers), own.worst_line[k],
                    _number(100 * own.within[k]), "" if worst is None else _number(100 * worst),
                ]
            )  # fmt: skip
    write_text(path, text.getvalue())


def write_layers_csv(path: Path, all_heads: list[InkPrediction]) -> None:
    """A row for each layer."""
    text = _begun(LAYERS)
    writer = csv.writer(text, lineterminator="\n")
    for prediction in all_heads:
        for row in layer_rows(prediction):
            writer.writerow(
                [row[key] if key in LAYERS[:2] else _number(row[key]) for key in LAYERS]
            )
    write_text(path, text.getvalue())


def _begun(header: tuple[str, ...]) -> io.StringIO:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(header)
    return text


def _number(value: Any) -> str:
    return "" if np.isnan(value) else f"{value:.6g}"
