"""Solve pulsatile 0D flow (periodic state); write a row per vessel and waves at the ends."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from design.hemodynamics import (
    PulsatileConditions,
    end_waves,
    pulsatile_summary,
    pulsatile_table,
    question_pressure,
    solve_pulsatile,
)
from design.network import VesselNetwork
from design.units import PA_PER_MMHG
from kernels.arrays import FloatArray
from printctl.analysis.flow.tables import FlowTables

PULSES, WAVES = "flow_pulsatile.csv", "flow_waves.csv"


def solve_and_write(
    tables: FlowTables, network: VesselNetwork, conditions: PulsatileConditions, steps: int
) -> tuple[dict[str, Any], dict[str, FloatArray]]:
    """Find the periodic state, write `PULSES` and `WAVES`; return the summary and the waves.

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
    tables.put(PULSES, pulsatile_table(network, solution, conditions))
    waves = end_waves(network, solution, conditions, steps)
    tables.put(WAVES, waves)
    return summary, waves


def read_waves(path: Path) -> dict[str, FloatArray]:
    """Columns of `WAVES`."""
    with path.open(encoding="utf-8", newline="") as handle:
        rows = list(csv.DictReader(handle))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
