"""Combine the ink of several heads, each at its own tip's position."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from firmware_profiles import Printer
from printctl.lumens.filaments import Filaments
from printctl.lumens.strokes import IntArray, Strokes
from sim.dry_run.run import DryRun


def split_by_head(run: DryRun, printer: Printer) -> list[DryRun]:
    """The run as each head sees it: its rows, its blocks, its own tip's places."""
    return [
        replace(run.of_head(number), executed=run.executed.of_head(number, head.offset_mm.mm))
        for number, head in enumerate(printer.heads)
    ]


def stack_heads(each: Sequence[Strokes]) -> tuple[Strokes, IntArray]:
    """All heads' strokes, one head after the other, and the head of each."""
    head = np.repeat(np.arange(len(each)), [len(one.line) for one in each])
    whole = Strokes(
        np.concatenate([one.begin for one in each]),
        np.concatenate([one.end for one in each]),
        np.concatenate([one.dose_ul for one in each]),
        _counted_on([one.stroke for one in each]),
        np.concatenate([one.line for one in each]),
    )
    return whole, head


def stacked_filaments(each: Sequence[Filaments]) -> Filaments:
    """All heads' filaments, one head after the other."""
    return Filaments(
        np.concatenate([one.start for one in each]),
        np.concatenate([one.end for one in each]),
        np.concatenate([one.radius for one in each]),
        _counted_on([one.stroke for one in each]),
        np.concatenate([one.line for one in each]),
    )


def _counted_on(strokes: Sequence[IntArray]) -> IntArray:
    """Numbers of strokes, so that no two heads share one; ascending as before."""
    past = np.cumsum([0, *(int(one.max(initial=-1)) + 1 for one in strokes)])
    return np.concatenate([one + k for one, k in zip(strokes, past[:-1], strict=True)])
