"""Data class of the electrical-analogue circuit of vessels and outlets, for 0D solvers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics.waveforms import Waveform
from design.hemodynamics.zero_d.nodal.conductance import Structure, structure_of
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Circuit:
    """Branches of resistance, inertance and capacitance between nodes.

    Attributes
    ----------
    first, last : (b,) int64
        Nodes of each branch; its flow is positive from first to last.
    resistance, inertance, capacitance : (b,) float64, Pa·s/µL, Pa·s²/µL, µL/Pa
        Half of a branch's capacitance sits at each end, which knows no direction and is of second
        order in the branch's length.
    stored : (n,) float64, µL/Pa
        Capacitance to ground at each node, beside what branches have.
    held : (n,) bool
        Nodes whose pressure is given.
    drive : (n,) int64
        Which waveform gives the pressure of a held node (Pa), or the flow into another (µL/s);
        -1 for no flow.
    waveforms : tuple of Waveform
    womersley : (b,) float64, √s, or None
        Womersley number at 1 rad/s, for branches whose impedance is Womersley's; 0 elsewhere.
    """

    first: IntArray
    last: IntArray
    resistance: FloatArray
    inertance: FloatArray
    capacitance: FloatArray
    stored: FloatArray
    held: NDArray[np.bool_]
    drive: IntArray
    waveforms: tuple[Waveform, ...]
    womersley: FloatArray | None = None

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return len(self.stored)

    def structure(self) -> Structure:
        """What of it can be folded away."""
        return structure_of(np.column_stack([self.first, self.last]), self.held)

    def driven(self, samples: NDArray[Any]) -> NDArray[Any]:
        """What drives each node, (n,), for a value of each waveform (w,)."""
        values = np.zeros(self.node_count, samples.dtype)
        on = self.drive >= 0
        values[on] = samples[self.drive[on]]
        return values
