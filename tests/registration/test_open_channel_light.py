"""Evidence for gel beside the brighter gel below a wide channel that opens towards the light."""

from __future__ import annotations

import numpy as np
import pytest

from registration.segmentation import GelField, Strength
from registration.segmentation.evidence import gel_evidence

VOXEL = 0.05
PER_MM = 1.2
"""What gel takes of the light, there and back."""


@pytest.mark.parametrize("roof", [0, 4])
def test_gel_beside_the_light_of_a_wide_channel_is_gel(roof: int) -> None:
    """Below a channel 1.5 mm deep gel is six times as bright: it darkened the gel beside it.

    A published network's trunk, 1.9 mm wide, broke through the top: five false leaks around it.
    """
    gel = np.zeros((70, 60, 110), np.float32)
    gel[8:64, 5:55, 5:105] = 1.0
    gel[8 + roof : 40, :, 40:70] = 0.0
    above = np.cumsum(gel, axis=0) * VOXEL
    speckle = np.random.default_rng(3).exponential(size=gel.shape)
    signal = (gel * np.exp(-PER_MM * above) * speckle).astype(np.float32)
    field = GelField(gel, 0.5, 1.0, np.full(3, VOXEL), np.zeros(3), 0.05)
    evidence = gel_evidence(field, Strength(signal, 1e-3, signal.astype(np.float16), 0.0))
    beside = evidence.smooth[46:60, 15:45, 34:76]
    assert beside.mean() == pytest.approx(1.0, abs=0.08)
    assert beside.mean(axis=(0, 1)).min() > 0.85
