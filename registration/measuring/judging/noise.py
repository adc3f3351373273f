"""Estimate the measurement noise of a vessel's sections, unaffected by real diameter changes.

A stenosis over half a vessel widens the spread about the vessel's median, and would hide itself.
Two estimates don't see it: the scatter of a section's own rays, and differences of neighbouring
sections. The larger of both counts.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kernels.arrays import FloatArray
from registration.measuring.gauging.scatter import scatter


def random_um(errors: Sequence[FloatArray], noise: Sequence[FloatArray]) -> list[FloatArray]:
    """Standard uncertainty of each section of each vessel by noise alone, µm.

    Parameters
    ----------
    errors : sequence of (n,) float64, µm
        Measured less designed diameters of each vessel, in order along it; NaN where closed.
    noise : sequence of (n,) float64, µm
        Standard errors by the scatter of each section's rays; NaN where it has no outline.
    """
    fine = [scatter(error) for error in errors]
    known = [value for value in fine if np.isfinite(value)]
    pooled = float(np.median(known)) if known else 0.0
    return [
        np.asarray(np.fmax(rays, own if np.isfinite(own) else pooled))
        for rays, own in zip(noise, fine, strict=True)
    ]
