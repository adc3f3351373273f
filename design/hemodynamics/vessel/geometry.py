"""Integrals along vessels, exact for radii that go linearly from point to point."""

from __future__ import annotations

import numpy as np

from design.network import FloatArray, VesselNetwork


def integral_of_power(network: VesselNetwork, power: int) -> FloatArray:
    """∫ r^power ds over each vessel, (v,), mm^(power + 1).

    Along a piece of length ℓ whose radius goes linearly from a to b: ℓ (a² + a b + b²)/3 for 2,
    ℓ (a³ + a² b + a b² + b³)/4 for 3, ℓ/(a b) for -2, ℓ (a² + a b + b²)/(3 a³ b³) for -4.

    Raises
    ------
    KeyError
        For another power.
    """
    start, end, a, b, vessel = network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        piece = length * _MEAN[power](a, b)
    return np.asarray(np.bincount(vessel, weights=piece, minlength=network.vessel_count))


_MEAN = {
    2: lambda a, b: (a * a + a * b + b * b) / 3.0,
    3: lambda a, b: (a + b) * (a * a + b * b) / 4.0,
    -2: lambda a, b: 1.0 / (a * b),
    -4: lambda a, b: (a * a + a * b + b * b) / (3.0 * (a * b) ** 3),
}
