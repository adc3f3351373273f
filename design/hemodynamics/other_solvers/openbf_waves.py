"""Run an openBF case; write waves at five places of its vessels as CSV or NPZ, in SI units."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from design.files import atomic_replacement
from design.hemodynamics.one_d.solution import OneDSolution
from design.hemodynamics.one_d.solve import Progress, solve_one_d
from design.hemodynamics.other_solvers.openbf import PLACES, QUANTITIES, OpenBFCase
from design.units import PA_PER_MMHG
from kernels.arrays import FloatArray

_TO_SI: Final = {"P": 1.0, "Q": 1e-9, "A": 1e-6, "u": 1e-3}


@dataclass(frozen=True)
class OpenBFWaves:
    """Waves of the vessels to be written.

    Attributes
    ----------
    labels : (n,) tuple of str
    time_s : (t,) float64
        Of one cycle, its end left out.
    waves : dict of str to (n, 5, t) float64, SI units
        By quantity, at 0, ¼, ½, ¾ and all of each vessel's length.
    """

    labels: tuple[str, ...]
    time_s: FloatArray
    waves: dict[str, FloatArray]


def run_openbf(
    case: OpenBFCase, progress: Progress | None = None
) -> tuple[OneDSolution, OpenBFWaves]:
    """Find the periodic state, to 10⁻⁴ of the swing and to ``convergence_tolerance``.

    Raises
    ------
    FlowError
        As `solve_one_d`.
    """
    solution = solve_one_d(case.network, case.conditions, case.options, progress)
    swing = float(np.ptp(solution.pressure)) / PA_PER_MMHG
    if solution.change[-1] * swing > case.tolerance_mmhg:
        closer = replace(case.options, tolerance=case.tolerance_mmhg / swing)
        solution = solve_one_d(case.network, case.conditions, closer, progress)
    return solution, _waves(case, solution)


def _waves(case: OpenBFCase, solution: OneDSolution) -> OpenBFWaves:
    if solution.probes is None or solution.probe_area is None:
        raise ValueError("an openBF case has probes")
    flow, area = solution.probes.flow, solution.probe_area
    waves = dict(zip(QUANTITIES, (solution.probes.pressure, flow, area, flow / area), strict=True))
    shape = (len(case.labels), len(PLACES), -1)
    shown = list(case.shown)
    return OpenBFWaves(
        labels=tuple(case.labels[k] for k in shown),
        time_s=solution.time_s,
        waves={q: waves[q].reshape(shape)[shown] * _TO_SI[q] for q in case.quantities},
    )


def write_openbf_csv(path: Path, waves: OpenBFWaves) -> None:
    """Write a row for each vessel and time, five columns a quantity, at full precision.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    names = [f"{q}_{k + 1}" for q in waves.waves for k in range(len(PLACES))]
    with atomic_replacement(path) as draft, draft.open("w", encoding="utf-8", newline="") as out:
        out.write(",".join(["label", "time_s", *names]) + "\n")
        out.writelines(_lines(waves))


def _lines(waves: OpenBFWaves) -> Iterator[str]:
    for k, label in enumerate(waves.labels):
        rows = np.vstack([waves.time_s, *(w[k] for w in waves.waves.values())]).T
        for row in rows.tolist():
            yield f"{label},{','.join(map(repr, row))}\n"


def write_openbf_npz(path: Path, waves: OpenBFWaves) -> None:
    """Write NumPy arrays: ``label`` (n,), ``time_s`` (t,), and each quantity (n, 5, t).

    Raises
    ------
    OSError
        When the file can't be written.
    """
    arrays = {"label": np.array(waves.labels), "time_s": waves.time_s} | waves.waves
    with atomic_replacement(path) as draft:
        np.savez(draft, **arrays)  # type: ignore[arg-type]
