"""Write the results of an svZeroDSolver case, in the columns that svZeroDSolver writes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from design.files import atomic_replacement
from design.hemodynamics.zero_d.svzerod.case import SvZeroDCase
from design.hemodynamics.zero_d.svzerod.run import SvZeroDRun
from kernels.arrays import FloatArray

COLUMNS: Final = ("flow_in", "flow_out", "pressure_in", "pressure_out")


@dataclass(frozen=True)
class ResultTable:
    """Results as the file asks for them: of vessels or of variables, in time or their mean.

    Attributes
    ----------
    names : tuple of str
        Of vessels, or of variables.
    time : (t,) float64
        Empty where the mean is asked for.
    columns : dict of str to (t, m) float64
        By svZeroDSolver's column names; of a mean (1, m).
    """

    names: tuple[str, ...]
    time: FloatArray
    columns: dict[str, FloatArray]


def result_table(case: SvZeroDCase, run: SvZeroDRun) -> ResultTable:
    """Return what the file's options ask for."""
    how = case.options
    parts = {"": run.value, "d_": run.rate} if how.output_derivative else {"": run.value}
    if how.output_variable_based:
        names, columns = run.names, {"ydot" if d else "y": x for d, x in parts.items()}
    else:
        names = case.names
        count = len(names)
        columns = {
            d + name: x[:, k * count : (k + 1) * count]
            for d, x in parts.items()
            for k, name in enumerate(COLUMNS)
        }
    if not how.output_mean_only:
        return ResultTable(names, run.time, columns)
    means = {name: x.mean(axis=0, keepdims=True) for name, x in columns.items()}
    return ResultTable(names, np.zeros(0), means)


def write_svzerod_csv(path: Path, table: ResultTable) -> None:
    """Write svZeroDSolver's table, numbers in the fewest digits that read back the same.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    with atomic_replacement(path) as draft, draft.open("w", encoding="utf-8", newline="") as out:
        out.write(",".join(["name", "time", *table.columns]) + "\n")
        out.writelines(_blocks(table))


def _blocks(table: ResultTable) -> Iterator[str]:
    """Yield the lines of one name at a time."""
    times = [repr(t) for t in np.round(table.time, 12).tolist()] or [""]
    values = ",".join(["%r"] * len(table.columns))
    form = "".join(f"\0,{time},{values}\n" for time in times)
    columns = list(table.columns.values())
    for k, name in enumerate(table.names):
        rows = np.stack([column[:, k] for column in columns], axis=1)
        yield (form % tuple(rows.ravel().tolist())).replace("\0", name)


def write_svzerod_npz(path: Path, table: ResultTable) -> None:
    """Write the table as NumPy arrays: ``name`` (m,), ``time`` (t,), and each column (t, m).

    Raises
    ------
    OSError
        When the file can't be written.
    """
    with atomic_replacement(path) as draft:
        np.savez(draft, name=np.array(table.names), time=table.time, **table.columns)  # type: ignore[arg-type]
