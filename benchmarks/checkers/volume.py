"""Volume of a network's lumens."""

from __future__ import annotations

import numpy as np

from benchmarks.checkers.read_network import FloatArray, Pieces


def total_volume(net: Pieces, radius: FloatArray | None = None) -> float:
    """Σ π ℓ (r0² + r0 r1 + r1²) / 3, mm³; with ``radius`` (n,) instead of the file's own."""
    r0, r1 = net.radius.T if radius is None else (radius, radius)
    return float((np.pi / 3.0 * net.length * (r0 * r0 + r0 * r1 + r1 * r1)).sum())
