"""Compute OCT depth profiles from interference spectra, by a Fourier sum over wavenumbers.

A reflector at the one-way optical path z gives a fringe cos(2 k z) over the wavenumber k. With
the sample's place q on an even scale of k (0 to n - 1), the profile at depth index m is
``|sum_p w_p s_p exp(-i φ_p) exp(-2 π i m q_p / n)|²``: nothing is interpolated.
W. Drexler, J. G. Fujimoto (eds.), Optical Coherence Tomography, 2nd ed., 2015, ch. 2 and 5.

Not modelled: the spectrometer's own roll-off, the mirror image of what lies above the zero of
path, a source's shape (it isn't divided out).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kernels.arrays import FloatArray

WINDOWS = ("hann", "none")


@dataclass(frozen=True)
class Spectrometer:
    """Where a spectrum's samples lie, and how they are weighed.

    Attributes
    ----------
    place : (n,) float64
        Of each sample on an even scale of wavenumber, from 0 to n - 1, rising.
    dispersion : (a2, a3), rad
        Phase to take out, a2 u² + a3 u³, with u from -1 to 1 over the band.
    window : "hann" or "none"
        Over the band.
    """

    place: FloatArray
    dispersion: tuple[float, float] = (0.0, 0.0)
    window: str = "hann"

    def kernel(self) -> NDArray[np.float32]:
        """The sum's factors, (n, 2 (n // 2)): real parts of all depths, then imaginary ones."""
        count = len(self.place)
        across = self.place / (count - 1)
        weight = np.gradient(self.place)
        if self.window == "hann":
            weight = weight * (0.5 - 0.5 * np.cos(2 * np.pi * across))
        u = 2 * across - 1
        phase = self.dispersion[0] * u**2 + self.dispersion[1] * u**3
        turns = np.outer(self.place, np.arange(count // 2)) / count
        factors = (weight * np.exp(-1j * phase))[:, None] * np.exp(-2j * np.pi * turns)
        factors /= weight.sum()
        return np.ascontiguousarray(np.hstack([factors.real, factors.imag]), dtype=np.float32)


def profiles(spectra: NDArray[np.generic], kernel: NDArray[np.float32]) -> NDArray[np.float32]:
    """Linear intensity (lines, n // 2) of spectra less their background (lines, n)."""
    plain = np.ascontiguousarray(spectra, dtype=np.float32)
    parts = np.square(plain @ kernel)
    half = kernel.shape[1] // 2
    return np.asarray(parts[:, :half] + parts[:, half:], dtype=np.float32)


def place_of_wavelengths(wavelength_nm: ArrayLike) -> tuple[FloatArray, float]:
    """Places on an even scale of wavenumber and the depth step, mm of one-way optical path.

    Raises
    ------
    ValueError
        When the wavelengths aren't positive or don't run one way.
    """
    wavelength = np.asarray(wavelength_nm, dtype=np.float64)
    steps = np.diff(wavelength)
    if not (np.isfinite(wavelength).all() and wavelength.min() > 0):
        raise ValueError("wavelengths must be numbers above 0")
    if not ((steps > 0).all() or (steps < 0).all()):
        raise ValueError("wavelengths must all rise or all fall")
    wavenumber = 2e6 * np.pi / wavelength  # rad/mm
    span = float(np.ptp(wavenumber))
    count = len(wavelength)
    place = (wavenumber - wavenumber.min()) / span * (count - 1)
    return place, np.pi * (count - 1) / (count * span)
