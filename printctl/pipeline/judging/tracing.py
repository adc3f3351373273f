"""Trace a print's defects and layer deviations to the job's layers, vessels and G-code lines.

Registration knows the part's frame only. Here its deviations and defects are joined with the run
folder's line map, and, for a defect, with the moves of the G-code itself that wrote around it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from design.geometry.polyline import arc_lengths, places_along
from design.network import VesselNetwork
from firmware_profiles import Printer
from gcode.deposit.written import Strands
from gcode.heads import read_with_valve
from kernels.arrays import FloatArray, IntArray
from printctl.checks.lumens.written_moves import plunger_strokes, valve_strokes
from registration import RegistrationReport
from registration.json_ready import Record

_ALONG_MM = 0.2
"""Places along a defect at which moves beside it are looked for."""


@dataclass(frozen=True)
class Job:
    """A job's writing moves and whose they are, part frame.

    Attributes
    ----------
    moves : Strands
    source : (n,) int64
        Layer, or vessel, from 0, of each move.
    of_vessels : bool
        Whether `source` counts vessels.
    first_line, last_line : (s,) int64
        Of each layer's or vessel's lines, travels included; 0 where it has none.
    """

    moves: Strands
    source: IntArray
    of_vessels: bool
    first_line: IntArray
    last_line: IntArray


def read_job(
    gcode: Path, line_map: Path, printer: Printer, start_mm: FloatArray, place_mm: FloatArray
) -> Job:
    """Read a job and its map.

    Parameters
    ----------
    gcode, line_map : Path
        Of the run folder.
    printer : Printer
        Whose dispenser tells what is written.
    start_mm : (3,) mm
        Where the tip stands before the first line, printer's frame.
    place_mm : (3,) mm
        Part to printer.
    """
    with np.load(line_map, allow_pickle=False) as arrays_file:
        of_line = arrays_file["source"].astype(np.int64)
        of_vessels = str(arrays_file["source_kind"]) == "vessel"
    x, y, z = start_mm.tolist()
    program, valve = read_with_valve(gcode.read_bytes(), printer, (x, y, z))
    if valve is None:
        moves = plunger_strokes(program, 1.0, level=False)
    else:
        moves = valve_strokes(program, valve, 0.0, level=False)
    # What is written are the carriage's places; a tip stands aside.
    tips = np.array([head.offset_mm.mm for head in printer.heads or ()] or [(0.0, 0.0, 0.0)])
    aside = tips[program.tool[np.searchsorted(program.line, moves.line)]] - place_mm
    moves = replace(moves, start=moves.start + aside, end=moves.end + aside)
    first, last = _spans(of_line)
    return Job(
        moves=moves,
        source=of_line[moves.line - 1],
        of_vessels=of_vessels,
        first_line=first,
        last_line=last,
    )


def _spans(of_line: IntArray) -> tuple[IntArray, IntArray]:
    """First and last line, from 1, of each source."""
    known = np.flatnonzero(of_line >= 0)
    count = int(of_line.max(initial=-1)) + 1
    first, last = np.full(count, len(of_line) + 1), np.zeros(count, dtype=np.int64)
    np.minimum.at(first, of_line[known], known + 1)
    np.maximum.at(last, of_line[known], known + 1)
    return np.where(last > 0, first, 0), last


def by_layer(report: RegistrationReport, job: Job) -> list[dict[str, float | None]]:
    """Deviation after the scaled fit of the seen surface in each layer, and the layer's lines.

    Parameters
    ----------
    report : RegistrationReport
    job : Job
        Written in layers, each below the height that its lines are written at.
    """
    again = report.scaled_scan_to_part @ np.linalg.inv(report.transform_scan_to_part)
    z = report.surface.vertices @ again[2, :3] + again[2, 3]
    count, tops = len(job.first_line), layer_tops(job)
    known = report.seen & np.isfinite(report.scaled_deviation_um)
    layer = np.minimum(np.searchsorted(tops, z[known], side="right"), count - 1)
    deviation = report.scaled_deviation_um[known]
    points = np.bincount(layer, minlength=count)
    some = np.maximum(points, 1)
    mean = np.bincount(layer, deviation, count) / some
    rms = np.sqrt(np.bincount(layer, deviation**2, count) / some)
    return [
        {
            "layer": index,
            "z_mm": float(tops[index]),
            "points": int(points[index]),
            "mean_um": float(mean[index]) if points[index] else None,
            "rms_um": float(rms[index]) if points[index] else None,
            "first_line": int(job.first_line[index]),
            "last_line": int(job.last_line[index]),
        }
        for index in range(count)
    ]


def layer_tops(job: Job) -> FloatArray:
    """Height that each layer's lines are written at, (s,), mm; between others where it has none.

    The median of a layer's lines: those that prime the needle count with the first one.
    """
    height = {k: float(np.median(job.moves.end[job.source == k, 2])) for k in np.unique(job.source)}
    known = np.array(sorted(k for k in height if k >= 0))
    return np.interp(np.arange(len(job.first_line)), known, [height[k] for k in known])


def made_by(
    defect: Record, job: Job, network: VesselNetwork, line_mm: float
) -> dict[str, int | list[int]]:
    """Layers or vessels, and lines, that wrote around a defect.

    Parameters
    ----------
    defect : dict
        Of registration.json: `vessel`, `from_mm`, `to_mm`, `point_mm`, `kind`.
    job : Job
    network : VesselNetwork
        The design, part frame.
    line_mm : float, mm
        A written line's width: what borders on the lumen within one and a half of it.

    Returns
    -------
    dict
        ``layers`` or ``vessels`` (numbers), ``first_line``, ``last_line``, ``line_count``;
        ``line_count`` is 0 where nothing was written near.
    """
    points, radii = network.polyline(defect["vessel"])
    upto = arc_lengths(points)
    count = 1 + max(1, int(np.ceil((defect["to_mm"] - defect["from_mm"]) / _ALONG_MM)))
    along = np.linspace(defect["from_mm"], defect["to_mm"], count)
    axis = places_along(points, upto, along)
    reach = np.interp(along, upto, radii) + 1.5 * line_mm
    if defect["kind"] in ("leak", "bridge"):
        axis = np.array([defect["point_mm"]])
        reach = np.array([defect["size_um"] * 5e-4 + 1.5 * line_mm])
    near = _beside(job, axis, reach)
    lines, sources = job.moves.line[near], np.unique(job.source[near])
    return {
        "vessels" if job.of_vessels else "layers": sources[sources >= 0].tolist(),
        "first_line": int(lines.min()) if len(lines) else 0,
        "last_line": int(lines.max()) if len(lines) else 0,
        "line_count": len(np.unique(lines)),
    }


def _beside(job: Job, places: FloatArray, reach: FloatArray) -> NDArray[np.bool_]:
    """Moves that come within `reach` of one of the places."""
    near = np.zeros(len(job.moves.line), dtype=np.bool_)
    way = job.moves.end - job.moves.start
    square = np.maximum((way**2).sum(axis=1), 1e-18)
    for place, limit in zip(places, reach, strict=True):
        t = np.clip(((place - job.moves.start) * way).sum(axis=1) / square, 0, 1)
        off = job.moves.start + t[:, None] * way - place
        near |= (off**2).sum(axis=1) <= limit**2
    return near
