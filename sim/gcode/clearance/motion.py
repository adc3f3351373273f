"""Tip motion of every needle by G-code row, and the rows that write, from a dry run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray
from sim.errors import ClearanceError
from sim.gcode.dry_run.run import DryRun
from sim.gcode.program.modal import MOVE

NONE = -1


@dataclass(frozen=True)
class LineSources:
    """What a job's map says of its lines.

    Attributes
    ----------
    vessel : (lines,) int64
        Which vessel each line is for; -1 for none.
    writes : (lines,) bool or None
        Whether a line is there to write; None where the map doesn't say, so that the ink tells.
    """

    vessel: IntArray
    writes: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class NeedleMotion:
    """Rows in the order of time, in the printer's frame.

    Attributes
    ----------
    tips : (heads, n, 2, 3) float64, mm
        Each head's tip before and after each row; a raised one where it stands raised.
    tool : (n,) int64
        The head in use.
    line : (n,) int64
        Of the file, from 1.
    volume_ul : (n,) float64, µL
        What comes out of the head in use.
    writes : (n,) bool
        Whether the row is of a pass: the tip moves and writes.
    vessel : (n,) int64
        What the row is for; -1 for none.
    """

    tips: FloatArray
    tool: IntArray
    line: IntArray
    volume_ul: FloatArray
    writes: NDArray[np.bool_]
    vessel: IntArray

    @property
    def length_mm(self) -> FloatArray:
        """Way of the carriage in each row, (n,), mm."""
        ends = self.tips[0]
        return np.asarray(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))


def motion_of(run: DryRun, sources: LineSources, volume_ul: FloatArray) -> NeedleMotion:
    """What a file's needles do, as the simulator's reader executes it.

    Places are those of the text; a printer's lie within half a motor step of them. A line for
    writing without ink (a coast at a pass's end) is of its pass, but leaves nothing.

    Parameters
    ----------
    run : DryRun
    sources : LineSources
    volume_ul : (rows,) float64, µL
        What comes out of the head in use in each row of the program.

    Raises
    ------
    ClearanceError
        When the map is of another file.
    """
    program = run.program
    if len(program) and int(program.line.max()) > len(sources.vessel):
        raise ClearanceError(
            f"the map is of {len(sources.vessel)} lines, and the G-code has "
            f"{int(program.line.max())}: it belongs to another file; write both anew"
        )
    tips = np.stack([run.heads.tips(program, k) for k in range(len(run.heads.lift_mm))])
    moves = program.kind == MOVE
    moved = moves & (np.abs(tips[0, :, 1] - tips[0, :, 0]).max(axis=1, initial=0.0) > 0)
    flows = moved & (volume_ul > 0)
    writes = flows
    if sources.writes is not None:
        writes = moved & (sources.writes[program.line - 1] | flows)
    vessel = sources.vessel[program.line - 1].astype(np.int64)
    return NeedleMotion(
        tips, program.tool, program.line, np.where(moved, volume_ul, 0.0), writes, vessel
    )
