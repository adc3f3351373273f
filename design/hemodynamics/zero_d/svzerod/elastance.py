"""Fourier coefficients of the ventricles' elastance in svZeroDSolver's closed loops.

The numbers are part of what its files mean (Menon et al. 2023, "Predictors of myocardial ischemia
in patients with Kawasaki disease", after J. Tran's tuning framework):
E(t)/E_scale = Σ a_k cos(2πkt/T) - b_k sin(2πkt/T).
"""

from __future__ import annotations

from typing import Final

import numpy as np

COSINES: Final = np.array([
    0.283748803, 0.031830626, -0.2094724, 0.020520047, 0.008316883, -0.04167766, 0.000867323,
    -0.001675379, -0.011252277, -0.000414677, 0.000253749, -0.002584966, 0.000584752,
    0.000028502, 0.000022961, 0.000018735, 0.000015573, 0.000013133, 0.000011199, 0.000009634,
    0.000008343, 0.000007265, 0.000006354, 0.000005575, 0.000004903,
])  # fmt: skip
SINES: Final = np.array([
    0.0, -0.374299825, -0.01812777, 0.073971113, -0.047249597, 0.003212163, 0.019441411,
    -0.005565534, 0.003401432, 0.008376795, -0.00007188, 0.001566861, 0.003143555, -0.000024787,
    -0.000007476, -0.000001281, 0.000001781, 0.000003494, 0.000004507, 0.000005117, 0.000005481,
    0.000005687, 0.000005789, 0.000005821, 0.000005805,
])  # fmt: skip
