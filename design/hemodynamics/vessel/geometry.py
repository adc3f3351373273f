"""Integrate powers of the radius along each vessel (for resistance, volume and the like).

Along a piece of length ℓ whose radius goes from a to b they are ℓ (a² + a b + b²)/3 for r²,
ℓ (a + b) (a² + b²)/4 for r³, ℓ/(a b) for r⁻² and ℓ (a² + a b + b²)/(3 a³ b³) for r⁻⁴.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from design.network import VesselNetwork
from kernels import jit
from kernels.arrays import FloatArray, IntArray

POWERS: Final = {0: 0, 1: 1, 2: 2, 3: 3, -2: 4, -4: 5}
"""Power of the radius to row of `integrals`."""


def integrals(network: VesselNetwork) -> FloatArray:
    """∫ r^power ds over each vessel for all `POWERS`, (6, v), mm^(power + 1); 0 is the length."""
    sums = np.zeros((len(POWERS), network.vessel_count))
    _integrate(
        np.ascontiguousarray(network.points), np.asarray(network.radius), network.offset, sums
    )
    return sums


def integral_of_power(network: VesselNetwork, power: int) -> FloatArray:
    """∫ r^power ds over each vessel, (v,), mm^(power + 1).

    Raises
    ------
    KeyError
        For a power that isn't among `POWERS`.
    """
    return np.asarray(integrals(network)[POWERS[power]])


@jit
def _integrate(points: FloatArray, radius: FloatArray, offset: IntArray, sums: FloatArray) -> None:
    """Piece by piece; NumPy takes ten passes over a million vessels for it."""
    for vessel in range(sums.shape[1]):
        for k in range(offset[vessel], offset[vessel + 1] - 1):
            a, b, square = radius[k], radius[k + 1], 0.0
            for axis in range(3):
                square += (points[k + 1, axis] - points[k, axis]) ** 2
            length, ab = np.sqrt(square), a * b
            second = (a * a + ab + b * b) / 3.0
            sums[0, vessel] += length
            sums[1, vessel] += length * (a + b) / 2.0
            sums[2, vessel] += length * second
            sums[3, vessel] += length * (a + b) * (a * a + b * b) / 4.0
            sums[4, vessel] += length / ab
            sums[5, vessel] += length * second / (ab * ab * ab)
