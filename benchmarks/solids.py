"""Solids and FRESH layers: exact unions and open lumens: ``make bench-solids``.

PrusaSlicer runs beside the product where it is installed (``apt-get install prusa-slicer``), as a
process of its own with `solids_prusa.ini`. ``--only NAME`` measures a part; ``--quick`` leaves the
20,000 segments, the kidney of 8,000 terminals and the large part out.
"""

from __future__ import annotations

from benchmarks.command import Job, run
from benchmarks.solids_bent import rows as bent_rows
from benchmarks.solids_fittings import rows as fittings_rows
from benchmarks.solids_large import rows as large_rows
from benchmarks.solids_lumens import rows as lumens_rows
from benchmarks.solids_organs import rows as organs_rows
from benchmarks.solids_slicing import rows as slicing_rows
from benchmarks.solids_union import rows as union_rows

JOBS: dict[str, Job] = {
    "slicing": lambda quick: slicing_rows(),
    "bent": lambda quick: bent_rows(),
    "lumens": lambda quick: lumens_rows(),
    "fittings": fittings_rows,
    "union": union_rows,
    "organs": organs_rows,
    "large": lambda quick: iter(()) if quick else large_rows(),
}


if __name__ == "__main__":
    run(JOBS, __doc__)
