"""Compute the solute exchange coefficient of each vessel piece with the tissue grid around it.

A vessel thinner than a cell is no boundary that the grid sees. Its flux is laid on the grid as a
smooth source and what the grid then says at the vessel is read with the same weights, so that the
coupling is symmetric; Green's function of a line gives what lies between that mean and the
concentration at the wall. It is Peaceman's well model (1978, doi 10.2118/6893-PA) with the source
spread on purpose, as by Koch et al. 2020 (doi 10.1016/j.jcp.2020.109370), so that it doesn't
depend on where in a cell, or in which direction, a vessel runs.
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from scipy.special import i0e

from design.hemodynamics.oxygen.conditions import OxygenConditions
from kernels.arrays import FloatArray

SMOOTHING: Final = 0.6234
"""Deviation, in cells and along each axis, of the Gaussian that answers as the grid does: laid on
27 cells by quadratic B-splines, spread by the five-point star in the plane across the vessel, and
read by the B-splines. From Green's functions of a 192 × 192 lattice for 40 places in a cell: a thin
line answers at its own place as the exact solution does 0.661 ± 0.027 cells away from it."""

_LOW, _HIGH = 1e-5, 1e8


def subgrid(radius: FloatArray, spacing_mm: float) -> FloatArray:
    """ln(r_e/r): 2π D (that at the wall less the mean read on the grid) per flux and length, (n,).

    The source is a ring of radius r blurred by a Gaussian of deviation s per axis. The mean
    of the blurred potential over the ring grows with the variance as the blurred ring's density
    there, so that ln(r_e/r) = ½ ∫ exp(-x) I₀(x)/x dx from (r/s)² on. For r ≪ s it goes to
    ln(√2 s/r) - γ/2, for r ≫ s to 0.
    """
    x, value = _table()
    asked = np.log((np.asarray(radius) / (SMOOTHING * spacing_mm)) ** 2)
    thin = 0.5 * (np.log(2.0) - np.euler_gamma - asked)
    return np.where(asked < x[0], thin, np.interp(asked, x, value))


@cache
def _table() -> tuple[FloatArray, FloatArray]:
    """The integral over ln x, from the top down; above it exp(-x) I₀(x) is 1/√(2π x)."""
    x = np.linspace(np.log(_LOW), np.log(_HIGH), 20_001)
    density = 0.5 * i0e(np.exp(x))
    steps = 0.5 * (density[1:] + density[:-1]) * (x[1] - x[0])
    above = np.append(np.cumsum(steps[::-1])[::-1], 0.0)
    return x, above + 1.0 / np.sqrt(2.0 * np.pi * _HIGH)


def exchange(
    radius: FloatArray, length: FloatArray, spacing_mm: float, conditions: OxygenConditions
) -> FloatArray:
    """Flux between stream and grid per difference of concentration, (n,), µL/s.

    Two resistances in series per length: 1/(π D Sh) in the stream (Hellums et al. 1996,
    Ann Biomed Eng 24, 1) and ln(r_e/r)/(2π D) between the wall and what the grid resolves.
    """
    stream = 1.0 / (np.pi * conditions.medium_diffusivity_mm2_s * conditions.sherwood)
    tissue = subgrid(radius, spacing_mm) / (2.0 * np.pi * conditions.tissue_diffusivity_mm2_s)
    return np.asarray(length / (stream + tissue))
