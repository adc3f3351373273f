"""Solve an svZeroDSolver case here, and write a CSV with svZeroDSolver's output columns."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from design.files import write_text
from design.hemodynamics.zero_d.pulsatile.march import Marched, march
from design.hemodynamics.zero_d.svzerod.case import SvZeroDCase

COLUMNS = ("name", "time", "flow_in", "flow_out", "pressure_in", "pressure_out")


def run_svzerod(case: SvZeroDCase) -> Marched:
    """Step through the case's cycles; the last one is returned.

    Raises
    ------
    FlowError
        As `march`.
    """
    return march(case.circuit, case.options)


def write_svzerod_csv(path: Path, case: SvZeroDCase, found: Marched) -> None:
    """Write the last cycle, vessel by vessel.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    first, last = case.circuit.first, case.circuit.last
    time = np.round(found.time_s, 12).tolist()
    for k, name in enumerate(case.names):
        columns = (
            found.flow_first[:, k],
            found.flow_last[:, k],
            found.pressure[:, first[k]],
            found.pressure[:, last[k]],
        )
        writer.writerows(
            (name, *row) for row in zip(time, *(c.tolist() for c in columns), strict=True)
        )
    write_text(path, out.getvalue())
