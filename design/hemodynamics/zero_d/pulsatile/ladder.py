"""Convert a circuit to R-L branches and grounded capacitors, for time stepping."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.errors import FlowError
from design.hemodynamics.zero_d.pulsatile.circuit import Circuit
from design.network import FloatArray, IntArray


@dataclass(frozen=True)
class Ladder:
    """Branches and capacitors, prepared for `march`.

    Attributes
    ----------
    ends : (l, 2) int64
        Nodes of the plain branches; nodes of the circuit first, then those amid its branches.
    resistance, inertance : (l,) float64
    stored : (n + more,) float64
        Capacitance at each node.
    into, out : (b,) int64
        The plain branch at either end of each branch of the circuit.
    at_first, at_last : (b,) float64
        Capacitance of its own that each has lumped at its ends.
    """

    ends: IntArray
    resistance: FloatArray
    inertance: FloatArray
    stored: FloatArray
    into: IntArray
    out: IntArray
    at_first: FloatArray
    at_last: FloatArray


def ladder_of(circuit: Circuit) -> Ladder:
    """Lump or spread a circuit's branches.

    Raises
    ------
    FlowError
        For a branch with neither resistance nor inertance.
    """
    r, i, c = circuit.resistance, circuit.inertance, circuit.capacitance
    bare = np.flatnonzero((r <= 0.0) & (i <= 0.0))
    if len(bare):
        raise FlowError(
            f"branch {int(bare[0])} has neither resistance nor inertance; join its nodes instead"
        )
    split = (r > 0.0) & (i > 0.0) & (c > 0.0) & circuit.middle
    amid = np.full(len(r), -1)
    amid[split] = circuit.node_count + np.arange(split.sum())
    ends = np.column_stack([circuit.first, np.where(split, amid, circuit.last)])
    beyond = np.column_stack([amid[split], circuit.last[split]])
    out = np.arange(len(r))
    out[split] = len(r) + np.arange(split.sum())
    # Between R and L: where one of them is missing, at the end that is nearer.
    whole = np.where(split, 0.0, c)
    at_first = np.where(i > 0.0, whole, 0.0) if circuit.middle else whole / 2.0
    if circuit.middle:
        at_first = np.where(r > 0.0, 0.0, at_first)
    at_last = whole - at_first
    stored = np.concatenate([circuit.stored, c[split]])
    np.add.at(stored, circuit.first, at_first)
    np.add.at(stored, circuit.last, at_last)
    return Ladder(
        np.concatenate([ends, beyond]),
        np.concatenate([r, np.zeros(split.sum())]),
        np.concatenate([np.where(split, 0.0, i), i[split]]),
        stored,
        np.arange(len(r)),
        out,
        at_first,
        at_last,
    )
