"""Convert a toolpath's moves to G-code commands: printer coordinates, E, feed rates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.toolpath.fresh.options import FreshOptions
from design.toolpath.toolpath import MoveKind, Toolpath
from firmware_profiles import Axes, Printer, Syringe
from kernels import jit
from kernels.arrays import FloatArray, IntArray

MARGIN_STEPS: Final = 1
"""One above Marlin's least, because rounding both ends to whole steps can take one away."""
TRAVEL, WITH_PLUNGER, DWELL = 0, 1, 4
"""Codes of `MachineMoves`: those of G-code."""


@dataclass(frozen=True)
class MachineMoves:
    """Commands of a job: where the machine stands after each, and how it gets there."""

    # (n, 4), mm, X, Y, Z in the printer's frame, and plunger travel since the job's begin.
    position: FloatArray
    speed_mm_s: FloatArray  # (n,), mm/s, along XYZ; of the plunger where only that moves
    pause_s: FloatArray  # (n,), s, of a dwell; 0 elsewhere
    code: IntArray  # (n,), 0 for a travel, 1 where the plunger takes part, 4 for a dwell
    source: IntArray  # (n,), as in `Gcode`
    move: IntArray  # (n,)

    def where(self, rows: NDArray[np.bool_]) -> MachineMoves:
        """Return the commands of a mask."""
        return MachineMoves(
            **{field.name: getattr(self, field.name)[rows] for field in fields(self)}
        )

    @staticmethod
    def to(position: FloatArray, speed_mm_s: float, code: int) -> MachineMoves:
        """One move to ``position`` (4,) that the toolpath doesn't know."""
        none = np.array([-1])
        return MachineMoves(
            position[None], np.array([speed_mm_s]), np.zeros(1), np.array([code]), none, none
        )

    @staticmethod
    def joined(parts: Sequence[MachineMoves]) -> MachineMoves:
        """Commands one after another."""
        columns = {
            field.name: np.concatenate([getattr(part, field.name) for part in parts])
            for field in fields(MachineMoves)
        }
        return MachineMoves(**columns)


def plunger_mm_per_ul(printer: Printer, syringe: Syringe) -> float:
    """Plunger travel per volume, mm/µL: 4 / (π D²); 0 where there is no plunger."""
    return 0.0 if printer.pneumatic else float(4.0 / (np.pi * syringe.inner_mm**2))


def machine_moves(
    toolpath: Toolpath,
    printer: Printer,
    syringe: Syringe,
    place_mm: FloatArray,
    flow_factor: float = 1.0,
    before_ul: float = 0.0,
) -> MachineMoves:
    """Commands of a toolpath, with the moves merged that the firmware would drop.

    ``before_ul`` is what the job has pushed before it, µL.
    """
    per_ul = plunger_mm_per_ul(printer, syringe) / flow_factor
    pushed = np.cumsum(np.append(before_ul, toolpath.volume_ul))
    position = np.column_stack([toolpath.end + place_mm, pushed[1:] * per_ul])
    begin = np.append(toolpath.start[0] + place_mm, before_ul * per_ul)
    keep = long_enough(
        np.vstack([begin, position]) * per_axis(printer.steps_per_mm),
        _runs(toolpath),
        printer.min_steps_per_segment + MARGIN_STEPS,
    )
    move = np.flatnonzero(keep)
    kind = toolpath.kind
    standing = np.isin(kind, (MoveKind.PRIME, MoveKind.RETRACT))
    duration = np.where(standing, toolpath.duration_s, 1.0)
    along_e = np.abs(toolpath.volume_ul) * per_ul / duration
    code = np.where(kind == MoveKind.TRAVEL, TRAVEL, WITH_PLUNGER)
    code = np.where(kind == MoveKind.DWELL, DWELL, code)
    return MachineMoves(
        position[move],
        np.where(standing, along_e, toolpath.speed_mm_s)[move],
        np.where(kind == MoveKind.DWELL, toolpath.duration_s, 0.0)[move],
        code[move],
        toolpath.source[move],
        move,
    )


def per_axis(axes: Axes) -> FloatArray:
    """One number for X, Y, Z and E, (4,)."""
    return np.array([getattr(axes, name) for name in "xyze"])


def _runs(toolpath: Toolpath) -> IntArray:
    """Number of the run of writing moves of one source that each move belongs to, or -1."""
    key = np.column_stack([toolpath.kind, toolpath.source, toolpath.tool])
    change = np.concatenate([[True], (key[1:] != key[:-1]).any(axis=1)])
    return np.where(toolpath.kind == MoveKind.WRITE, np.cumsum(change), -1)


def least_move_mm(printer: Printer) -> float:
    """Shortest move, along the longer of x and y, that the firmware doesn't merge, mm."""
    steps = printer.min_steps_per_segment + MARGIN_STEPS
    return steps / min(printer.steps_per_mm.x, printer.steps_per_mm.y)


def clear_mm(printer: Printer) -> float:
    """How far ink should keep from a lumen, mm: an eighth of a motor step.

    Points are rounded by up to half a step either way. Keeping half a step away would make every
    lumen wider than designed on a machine that is finer than its steps; an eighth leaves both
    errors about the same (benchmarks/solids.py: 80 steps/mm).
    """
    return 0.125 / min(printer.steps_per_mm.x, printer.steps_per_mm.y)


def joint_mm(printer: Printer) -> float:
    """Longest joint of two infill lines, mm: none where ink flows by time, as turns take longer."""
    return 0.0 if printer.pneumatic else FreshOptions.joint_mm


# Marlin drops a block of fewer than its least steps and adds it to the next one: a corner is cut
# where the firmware likes. Here those vertices stay that leave moves long enough and cut off least
# in all. Positions and E are absolute, so dropping a vertex loses neither place nor ink.
MAX_MERGED_LEAST_MOVES: Final = 10.0
"""Vertices left out one after the other stand along at most so many least moves, given a choice."""


@jit
def _steps(a: FloatArray, b: FloatArray) -> float:
    most = 0.0
    for axis in range(4):
        most = max(most, abs(b[axis] - a[axis]))
    return most


@jit
def _cut(position: FloatArray, begin: int, end: int, most: float) -> float:
    """What a stretch from one vertex to a later one cuts off, steps³; it may stop beyond ``most``.

    Squared distances of the vertices between, XYZ, times half of the way beside them.
    """
    a, c = position[begin], position[end]
    length = total = 0.0
    for k in range(3):
        length += (c[k] - a[k]) ** 2
    for v in range(begin + 1, end):
        b = position[v]
        along = beside = 0.0
        for k in range(3):
            along += (b[k] - a[k]) * (c[k] - a[k])
            beside += abs(b[k] - position[v - 1][k]) + abs(b[k] - position[v + 1][k])
        share = min(1.0, max(0.0, along / length)) if length > 0 else 0.0
        for k in range(3):
            total += 0.5 * beside * (b[k] - a[k] - share * (c[k] - a[k])) ** 2
        if total > most:
            break
    return total


@jit
def _merge(
    position: FloatArray, begin: int, end: int, least: float, keep: NDArray[np.bool_]
) -> None:
    """Choose the vertices of a run that cut off least in all, from its first to its last."""
    best = np.full(end - begin + 1, np.inf)
    before = np.zeros(end - begin + 1, np.int64)
    best[0] = 0.0
    for v in range(begin + 1, end + 1):
        way = 0.0
        for u in range(v - 1, begin - 1, -1):
            if u + 2 < v:
                way += _steps(position[u + 1], position[u + 2])
            if way > MAX_MERGED_LEAST_MOVES * least and best[v - begin] < np.inf:
                break
            if best[u - begin] == np.inf or _steps(position[u], position[v]) < least:
                continue
            lost = _cut(position, u, v, best[v - begin])
            if best[u - begin] + lost < best[v - begin]:
                best[v - begin], before[v - begin] = best[u - begin] + lost, u - begin
    keep[begin : end - 1] = False
    v = before[end - begin]  # 0 where the run as a whole is too short
    while v > 0:
        keep[begin + v - 1] = True
        v = before[v]


@jit
def _keep(position: FloatArray, run: IntArray, least: float) -> NDArray[np.bool_]:
    """Whether each move's end stays; ``position`` (n + 1, 4) in steps, run -1 isn't merged."""
    keep = np.ones(len(run), np.bool_)
    begin, short = 0, False  # move k goes from vertex k to vertex k + 1
    for k in range(len(run)):
        if k > 0 and run[k] != run[k - 1]:
            begin, short = k, False
        short = short or _steps(position[k], position[k + 1]) < least
        if short and run[k] >= 0 and (k + 1 == len(run) or run[k + 1] != run[k]):
            _merge(position, begin, k + 1, least, keep)
    return keep


def long_enough(position_steps: FloatArray, run: IntArray, least_steps: float) -> NDArray[np.bool_]:
    """Which moves' end points to keep so that no move of a run is shorter than the least.

    Parameters
    ----------
    position_steps : (n + 1, 4) float64, motor steps
        X, Y, Z and E before the first move and after each.
    run : (n,) int64
        Number of the run of moves that may merge with each other; -1 for a move that stays.
    least_steps : float
        The longest axis counts, as in Marlin. A run shorter than this as a whole stays one
        short move.
    """
    return _keep(np.ascontiguousarray(position_steps), run, least_steps)
