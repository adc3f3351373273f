"""Limit how hard a part's channels may be flushed."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class FlushLimit:
    """How hard the channels may be flushed.

    Attributes
    ----------
    pressure_pa : float, Pa
        Between inlet and outlet.
    wall_shear_pa : float, Pa
        That is allowed at the wall of ``vessel``, which is sheared most.
    """

    pressure_pa: float
    wall_shear_pa: float
    vessel: str


def flush_limit(flow_csv: Path, wall_shear_pa: float) -> FlushLimit | None:
    """Pressure at which the run's steady flow shears no wall more than allowed.

    Flow, pressure and wall shear of a Newtonian fluid in open, round channels grow together
    (Poiseuille), so the solved ones are scaled. None where the run solved no flow. A vessel counts
    by its mean radius: the narrow end of a taper has more, by 1 / r³.

    Parameters
    ----------
    flow_csv : Path
        Table of the stage ``flow``.
    wall_shear_pa : float, Pa
    """
    try:
        with flow_csv.open(encoding="utf-8", newline="") as handle:
            rows = list(csv.DictReader(handle))
        shear = [abs(float(row["wall_shear_pa"])) for row in rows]
        pressures = [float(row[k]) for row in rows for k in ("pressure_in_pa", "pressure_out_pa")]
    except (OSError, KeyError, ValueError):
        return None
    if not shear or max(shear) <= 0:
        return None
    worst = max(range(len(rows)), key=shear.__getitem__)
    drop = max(pressures) - min(pressures)
    name = rows[worst].get("vessel", "")
    return FlushLimit(drop * wall_shear_pa / shear[worst], wall_shear_pa, str(name))
