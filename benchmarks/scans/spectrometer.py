"""Simulate a spectral-domain OCT detector: interferogram to image.

Modelled: Gaussian source spectrum, finite resolution of the spectrometer (roll-off), shot and read
noise, the transform back; overlap of beams of neighbouring A-scans out of focus, along x. Not
modelled: autocorrelation of the sample's light, dispersion left over, errors of the wavenumber's
scale, jitter of the trigger.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

FINE, PIXEL = 8, 4
"""Fine cells of depth per voxel, and per pixel of the transform."""


@dataclass(frozen=True)
class Spectrometer:
    """Settings of the detector; lengths in mm of depth in the file's index.

    ``cells`` of depth, ``delta`` mm each; ``resolution``: FWHM of the intensity of a single
    reflector; ``rolloff_db_mm``: loss of sensitivity; ``snr_db``: gel at focus over noise.
    """

    cells: int
    delta: float
    resolution: float
    rolloff_db_mm: float
    snr_db: float

    @property
    def samples(self) -> int:
        """Samples of an interferogram."""
        return 2 * self.cells // PIXEL

    def source(self) -> np.ndarray:
        """Return the source's spectrum at the samples, unit peak."""
        n = np.arange(self.samples) - self.samples / 2
        sigma_pixels = self.resolution / (self.delta * PIXEL) / 1.665
        return np.asarray(np.exp(-0.5 * (n * 2 * np.pi * sigma_pixels / self.samples) ** 2))

    def image(self, light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return intensities (nx, pixels), 1 for gel at focus whose cells have mean power 1."""
        source, depth = self.source(), np.arange(self.cells) * self.delta
        kept = light * 10 ** (-self.rolloff_db_mm * depth / 20)
        whole = fft.fft(kept, 2 * self.cells, axis=1)[:, : self.samples]
        # Parseval: of a medium's light by depth, the rms fringe and the mean of a pixel.
        fringe = source * whole.real
        gel = self.cells / 2 * (source**2).sum()
        noise = np.sqrt(gel * 10 ** (-self.snr_db / 10) / self.samples)
        # four fifths of the noise's power are shot noise, which follows the source's spectrum
        share = np.sqrt(0.8 * source / source.mean() + 0.2)
        fringe = fringe + noise * share * rng.standard_normal(fringe.shape)
        image = np.abs(fft.fft(fringe, axis=1)[:, : self.samples // 2]) ** 2
        return np.asarray(image / gel)

    def reflection(self, decibels: float) -> float:
        """Return the amplitude in one cell whose image stands `decibels` over the gel."""
        source = self.source()
        gel = self.cells / 2 * (source**2).sum()
        return float(2 / source.sum() * np.sqrt(gel * 10 ** (decibels / 10)))


def overlap(light: np.ndarray, beam: np.ndarray, pitch: float, delta: float) -> np.ndarray:
    """Return light (nx, m) with the coherent overlap of neighbouring beams, mm; power is kept."""
    depth = np.arange(light.shape[1]) * delta
    wide = beam[0] * np.sqrt(1 + ((depth - beam[1]) / beam[2]) ** 2)
    reach = min(3, int(np.ceil(1.5 * wide.max() / pitch)))
    out, total = light.copy(), np.ones(light.shape[1])
    for step in range(1, reach + 1):
        weight = np.exp(-2 * (step * pitch / wide) ** 2).astype(np.float32)
        total += 2 * weight**2
        out[step:] += weight * light[:-step]
        out[:-step] += weight * light[step:]
    return np.asarray(out / np.sqrt(total))
