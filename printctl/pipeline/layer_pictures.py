"""Pictures of what the G-code writes, drawn from the G-code itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Printer
from registration.report import layer_figure
from sim.gcode_modal import MOVE
from sim.valve import read_with_valve

FloatArray = NDArray[np.float64]


def layer_pictures(
    gcode: Path,
    line_map: Path,
    width_mm: float,
    start_mm: tuple[float, float, float],
    printer: Printer,
) -> dict[str, bytes]:
    """Draw the layer in the middle and the one after it (the infill turns from one to the next).

    Parameters
    ----------
    gcode, line_map : Path
        The job and its map from line to layer.
    width_mm : float, mm
        Of a line.
    start_mm : (3,) mm
        Where the tip stands before the first line.
    printer : Printer
        Whose dispenser tells what is written.

    Returns
    -------
    dict of caption to SVG, for the report's toolpath section
    """
    with np.load(line_map) as found:
        layer_of_line = found["source"]
    program, valve = read_with_valve(gcode.read_bytes(), printer, start_mm)
    layer = layer_of_line[program.line - 1]
    moving = program.kind == MOVE
    start = np.vstack([program.start[None, :], program.target[:-1]])
    pushed = program.target[:, 3] > start[:, 3] if valve is None else valve.is_open
    path = np.linalg.norm(program.target[:, :2] - start[:, :2], axis=1) > 0
    count = int(layer.max()) + 1
    pictures = {}
    for index in sorted({(count - 1) // 2, min(count // 2 + (count % 2), count - 1)}):
        here = moving & path & (layer == index)
        height = program.target[here & pushed, 2]
        written = _polylines(start, program.target, here & pushed)
        travels = _polylines(start, program.target, here & ~pushed)
        caption = f"toolpath/Layer {index + 1} of {count}, tip at z = {height.max():.2f} mm"
        pictures[caption] = layer_figure(written, travels, width_mm)
    return pictures


def _polylines(start: FloatArray, end: FloatArray, keep: NDArray[np.bool_]) -> list[FloatArray]:
    """Runs of consecutive kept moves, each as points (k, 2)."""
    rows = np.flatnonzero(keep)
    if len(rows) == 0:
        return []
    runs = np.split(rows, np.flatnonzero(np.diff(rows) != 1) + 1)
    return [np.vstack([start[run[:1], :2], end[run, :2]]) for run in runs]
