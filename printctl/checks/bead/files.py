"""Write an ink prediction to a folder: tables, playback page, plots, voxels."""

from __future__ import annotations

import csv
import gzip
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.files import write_bytes, write_text
from design.solids import Solid, write_ply
from design.tissue.closed import isosurface
from gcode.bead.predict import Bead, laid_bead, swell
from gcode.deposit.lay import Deposit, deposit_of_laid
from kernels.arrays import IntArray
from printctl.checks.bead.play import make_playback
from printctl.checks.bead.predict import InkPrediction
from printctl.checks.bead.time_line import write_time_line
from printctl.checks.bead.vessels import VesselDiameters
from registration.files.exports import nrrd_header
from report.play import save_played, write_play_html


def layer_rows(prediction: InkPrediction) -> list[dict[str, Any]]:
    """A row for each layer that is written: volume, and width of its lines with and without lag."""
    late, prompt = (
        _by_layer(prediction.bead, prediction.source),
        _by_layer(prediction.prompt, prediction.prompt_source),
    )
    rows = []
    for layer, own in late.items():
        asked = prompt.get(layer)
        rows.append(
            {
                "head": prediction.head,
                "layer": layer,
                **own,
                "asked_ul": asked["laid_ul"] if asked else 0.0,
                "asked_width_mm": asked["width_mm"] if asked else 0.0,
            }
        )
    return rows


def _by_layer(bead: Bead, source: IntArray) -> dict[int, dict[str, Any]]:
    rows = np.flatnonzero(bead.writes)
    rows = rows[np.argsort(source[rows], kind="stable")]
    layers, first = np.unique(source[rows], return_index=True)
    by_number = {}
    for layer, own in zip(layers.tolist(), np.split(rows, first[1:]), strict=True):
        width, length = bead.width_mm[own], bead.pieces.length[own]
        order = np.argsort(width)
        way = np.cumsum(length[order])
        low, middle, high = np.searchsorted(way, way[-1] * np.array([0.05, 0.5, 0.95]))
        by_number[layer] = {
            "laid_ul": float(bead.flow.laid_ul[own].sum()),
            "width_mm": float(width[order][middle]),
            "narrow_mm": float(width[order][low]),
            "wide_mm": float(width[order][high]),
        }
    return by_number


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


HALF = 127.5
"""Of 255, the share of ink at which the surface runs."""


def write_voxels(path: Path, laid: Deposit) -> None:
    """Write the share of ink in each voxel, 0 to 255, in the printer's frame.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    volume = np.ascontiguousarray(laid.volume)
    header = nrrd_header(
        volume, np.eye(3) * laid.voxel_mm, laid.origin_mm, "predicted ink, printer's frame, mm"
    )
    write_bytes(path, header + gzip.compress(volume.tobytes(), 1, mtime=0))


def write_surface(path: Path, laid: Deposit) -> None:
    """Write the surface around the ink, in the printer's frame.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    surface = isosurface(laid.volume.transpose(2, 1, 0).astype(np.float32), HALF)
    vertices = (laid.origin_mm + laid.voxel_mm * surface.vertices).astype(np.float32)
    write_ply(path, Solid(vertices.astype(np.float64), surface.faces))


PLAY_PAGE: Final = "dry_run.html"
"""The page with the slider."""
PLAYED: Final = "predicted_play.npz"
"""The same for the report."""
VesselWidths = tuple[int, VesselDiameters, VesselDiameters | None]


@dataclass(frozen=True)
class OutputFiles:
    """Output files to write for a prediction.

    Attributes
    ----------
    voxel_mm : float or None, mm
        Of voxels and surface; neither without.
    window_s : (from, to) or None, s
        Of the time line; the whole without.
    title : str
        Of the page.
    keep_play : bool
        Whether the page's data are kept for a report.
    remarks : tuple of (int, str)
        Lines of the file, 0 for none, and what was found there otherwise; for the page.
    """

    voxel_mm: float | None = None
    window_s: tuple[float, float] | None = None
    title: str = "Dry run"
    keep_play: bool = False
    remarks: tuple[tuple[int, str], ...] = ()


def write_prediction(
    folder: Path,
    all_heads: Sequence[InkPrediction],
    vessels: Sequence[VesselWidths],
    facts: Sequence[Mapping[str, Any]],
    wanted: OutputFiles,
) -> list[str]:
    """Write tables, a page to play, a time line for each head, and voxels where they are wanted.

    Parameters
    ----------
    folder : Path
        Made where it isn't there.
    all_heads : sequence of InkPrediction
    vessels : sequence of (head, with lag, without lag)
        Empty where the network isn't known.
    facts : sequence of mapping
        `prediction_facts` of each head.
    wanted : OutputFiles

    Returns
    -------
    list of str
        Names of the files.

    Raises
    ------
    DepositError
        When the voxels would be too many.
    OSError
        When a file can't be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    names = ["predicted_bead.csv"]
    write_bead_csv(folder / names[0], list(all_heads))
    if vessels:
        names.append("predicted_vessels.csv")
        write_vessels_csv(folder / names[-1], list(vessels))
    if any(one.of_vessels is False for one in all_heads):
        names.append("predicted_layers.csv")
        write_layers_csv(folder / names[-1], list(all_heads))
    names += _write_play(folder, all_heads, vessels, facts, wanted)
    for one in all_heads:
        head = "" if len(all_heads) == 1 else f"_head{one.head}"
        names.append(f"time_line{head}.png")
        write_time_line(folder / names[-1], one, wanted.window_s)
        if wanted.voxel_mm is not None and np.any(one.bead.lays):
            laid = deposit_of_laid(laid_bead(one.bead, swell(one.mounting.ink)[0]), wanted.voxel_mm)
            write_voxels(folder / f"predicted{head}.nrrd", laid)
            write_surface(folder / f"predicted{head}.ply", laid)
            names += [f"predicted{head}.nrrd", f"predicted{head}.ply"]
    return names


def _write_play(
    folder: Path,
    all_heads: Sequence[InkPrediction],
    vessels: Sequence[VesselWidths],
    facts: Sequence[Mapping[str, Any]],
    wanted: OutputFiles,
) -> list[str]:
    if not any(np.any(one.bead.lays & one.bead.writes) for one in all_heads):
        return []
    held = {head: late for head, late, _ in vessels}
    shown = make_playback(all_heads, facts, held, wanted.remarks)
    write_play_html(folder / PLAY_PAGE, shown, wanted.title)
    if not wanted.keep_play:
        return [PLAY_PAGE]
    save_played(folder / PLAYED, shown)
    return [PLAY_PAGE, PLAYED]
