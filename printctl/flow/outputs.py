"""Solve pulsatile 0D flow; write a row per vessel and the waves at the network's ends."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from design.files import write_text
from design.hemodynamics import (
    PulsatileConditions,
    end_waves,
    pulsatile_summary,
    pulsatile_table,
    question_pressure,
    solve_pulsatile,
)
from design.network import FloatArray, VesselNetwork
from design.units import PA_PER_MMHG

PULSES, WAVES = "flow_pulsatile.csv", "flow_waves.csv"


def solve_and_write(
    folder: Path, network: VesselNetwork, conditions: PulsatileConditions, steps: int
) -> dict[str, Any]:
    """Find the periodic state, write `PULSES` and `WAVES`, return the summary.

    Raises
    ------
    FlowError
        As `solve_pulsatile`, or for an absurd pressure.
    OSError
        When a file can't be written.
    """
    solution = solve_pulsatile(network, conditions, steps)
    summary = pulsatile_summary(network, solution, conditions)
    question_pressure(summary["pressure_max_mmhg"] * PA_PER_MMHG)
    write_columns(folder / PULSES, pulsatile_table(network, solution, conditions))
    write_columns(folder / WAVES, end_waves(network, solution, conditions, steps))
    return summary


def write_columns(path: Path, table: Mapping[str, Any]) -> None:
    """Write columns of equal length as CSV at full precision."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
    write_text(path, out.getvalue())


def read_waves(path: Path) -> dict[str, FloatArray]:
    """Columns of `WAVES`."""
    with path.open(encoding="utf-8", newline="") as handle:
        rows = list(csv.DictReader(handle))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
