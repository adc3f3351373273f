"""Split a dry run by print head, and join all heads' written strokes into one list."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from firmware_profiles import Printer
from kernels.arrays import IntArray
from sim.gcode.deposit.strands import Strands
from sim.gcode.dry_run.run import DryRun


def split_by_head(run: DryRun, printer: Printer) -> list[DryRun]:
    """The run as each head sees it: its rows, its blocks, its own tip's places."""
    return [
        replace(run.of_head(number), executed=run.executed.of_head(number, head.offset_mm.mm))
        for number, head in enumerate(printer.heads)
    ]


def stack_heads(each: Sequence[Strands]) -> tuple[Strands, IntArray]:
    """All heads' strokes, one head after the other, and the head of each."""
    return Strands.joined(each), np.repeat(np.arange(len(each)), [len(one) for one in each])
