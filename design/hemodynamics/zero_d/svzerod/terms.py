"""Terms of svZeroDSolver's equations that aren't linear with fixed coefficients, as tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from kernels.arrays import FloatArray, IntArray

LOSS: Final = 0
"""-K |Q| Q: the pressure that a stenosis takes; constant K."""
STORED_LOSS: Final = 1
"""2 C K |Q| Q̇: what a stenosis takes at the compliance behind it; constant C K."""
AFFINE: Final = 2
"""a (y - c) + b ẏ with a, b, c that change in time: an elastance, a coronary in its muscle."""
EXPONENTIAL: Final = 3
"""-P of a chamber that is exponential at rest; E_max, K_p, K_v and V_so; its activation."""
TANH_VALVE: Final = 4
"""A resistance that goes over from R_min to R_max; R_max, R_min, steepness."""
JUMP_VALVE: Final = 5
"""A resistance that jumps; R_max, R_min."""
SPHERE: Final = 6
"""Momentum, stress, volume and active stress of a sphere; its activation."""
COUPLED: Final = 7
"""-f y of another block's y, without a derivative, as in svZeroDSolver: iterations go the same
way."""
GATE: Final = 8
"""R Q, Q, -Q … of a heart's valve, which is closed where neither flow nor pressure opens it."""

SMOOTH: Final = frozenset((LOSS, STORED_LOSS, AFFINE))
"""Kinds without jumps."""
_VARIABLES: Final = 5
_CONSTANTS: Final = 6
_TIMED: Final = 3


@dataclass(frozen=True)
class Moments:
    """Times at which terms are asked for.

    Attributes
    ----------
    times : (s,) float64
    period : float
    sampled : (s, tables) float64
    """

    times: FloatArray
    period: float
    sampled: FloatArray


Timed = Callable[[Moments], Sequence[FloatArray]]
"""Up to three coefficients that change in time, (s, m) each or what broadcasts to it."""


@dataclass(frozen=True)
class TermGroup:
    """Terms of one kind.

    Attributes
    ----------
    kind : int
    rows : (m, v) int64
        Equations that each adds to.
    variables : (m, c) int64
        What each depends on.
    slopes : tuple of (int, int)
        Places in ``rows`` and ``variables`` of the derivatives.
    constants : (m, q) float64
    timed : function or None
    """

    kind: int
    rows: IntArray
    variables: IntArray
    slopes: tuple[tuple[int, int], ...]
    constants: FloatArray
    timed: Timed | None = None


class Terms(NamedTuple):
    """All terms of a system, for kernels.

    Attributes
    ----------
    kind, first_value, first_slope : (t,), (t + 1,), (t + 1,) int64
    variables : (t, 5) int64
    constants : (t, 6) float64
    value_row : (p,) int64
        Equation of each value.
    slope_row, slope_column : (d,) int64
        Equation and variable of each derivative.
    """

    kind: IntArray
    first_value: IntArray
    first_slope: IntArray
    variables: IntArray
    constants: FloatArray
    value_row: IntArray
    slope_row: IntArray
    slope_column: IntArray


def joined_terms(groups: Sequence[TermGroup]) -> Terms:
    """Return the terms of all groups as one table."""
    sizes = [len(g.rows) for g in groups]
    each = [(g.rows.shape[1], len(g.slopes)) for g in groups]
    values, slopes = np.repeat(np.array(each, dtype=np.int64).reshape(-1, 2), sizes, axis=0).T
    nothing: list[IntArray] = [np.zeros(0, dtype=np.int64)]
    rows = [g.rows[:, [row for row, _ in g.slopes]].ravel() for g in groups]
    columns = [g.variables[:, [c for _, c in g.slopes]].ravel() for g in groups]
    return Terms(
        kind=np.repeat(np.array([g.kind for g in groups], dtype=np.int64), sizes),
        first_value=np.concatenate([[0], np.cumsum(values)]),
        first_slope=np.concatenate([[0], np.cumsum(slopes)]),
        variables=np.concatenate([_padded(g.variables, _VARIABLES) for g in groups]),
        constants=np.concatenate([_padded(g.constants, _CONSTANTS) for g in groups]),
        value_row=np.concatenate([g.rows.ravel() for g in groups]),
        slope_row=np.concatenate(nothing + rows),
        slope_column=np.concatenate(nothing + columns),
    )


def _padded(part: np.ndarray, width: int) -> np.ndarray:
    return np.ascontiguousarray(np.pad(part, ((0, 0), (0, width - part.shape[1]))))


def timed_coefficients(groups: Sequence[TermGroup], moments: Moments) -> FloatArray:
    """Return what changes in time, (s, t, 3), 0 where nothing does."""
    coefficients = np.zeros((len(moments.times), sum(len(g.rows) for g in groups), _TIMED))
    first = 0
    for group in groups:
        last = first + len(group.rows)
        if group.timed is not None:
            for k, part in enumerate(group.timed(moments)):
                coefficients[:, first:last, k] = part
        first = last
    return coefficients
