"""Table of a job's time, layer, vessel and ink after each command, to look up progress.

Made once per job from the dry run; an update of the progress then only reads one row.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final

import numpy as np

from design.files import atomic_replacement
from kernels.arrays import FloatArray, IntArray

NONE: Final = -1


@dataclass(frozen=True, eq=False)
class JobTable:
    """Row k tells how things stand when k commands of the job have been executed.

    Attributes
    ----------
    time_s : (n + 1,) float64, s
        Of the dry run; waits for heat count as nothing.
    ink_ul : (n + 1,) float64, µL
        Written so far, by all heads.
    plunger_mm : (n + 1,) float64, mm
        Travel of the plunger since the start, new syringes not counted.
    file_line : (n + 1,) int64
        Of the last command executed; 0 before the first.
    layer, vessel : (n + 1,) int64
        Which is being written, from 0; -1 for none. Of a job without levels a layer is a pass.
    layers_done, vessels_done : (n + 1,) int64
        How many have nothing left to be written.
    tip_mm : (n + 1, 3) float64, mm
        Where the tip stands, as the firmware counts.
    layer_count, vessel_count : () int64
    passes : () bool
        Whether layers are passes.
    """

    time_s: FloatArray
    ink_ul: FloatArray
    plunger_mm: FloatArray
    file_line: IntArray
    layer: IntArray
    vessel: IntArray
    layers_done: IntArray
    vessels_done: IntArray
    tip_mm: FloatArray
    layer_count: int = 0
    vessel_count: int = 0
    passes: bool = False

    def __len__(self) -> int:
        """Commands of the job."""
        return len(self.time_s) - 1

    def save(self, path: Path) -> None:
        """Write it as ``.npz``."""
        with atomic_replacement(path) as draft:
            np.savez(draft, **{one.name: getattr(self, one.name) for one in fields(self)})

    @staticmethod
    def load(path: Path) -> JobTable:
        """Read what `save` wrote."""
        with np.load(path, allow_pickle=False) as arrays_file:
            return JobTable(
                **{
                    one.name: arrays_file[one.name]
                    if arrays_file[one.name].ndim
                    else arrays_file[one.name].item()
                    for one in fields(JobTable)
                }
            )
