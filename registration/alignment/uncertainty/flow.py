"""Uncertainty interval of the pressure ratio of printed to designed network, by Monte Carlo."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kernels.arrays import FloatArray
from registration.alignment.uncertainty.sections import OWN_DOF, SectionErrors

DRAWS = 4000
PERCENTILES = (2.5, 97.5)


def pressure_interval(
    ratio: float,
    resistance: FloatArray,
    flow: FloatArray,
    vessels: Sequence[SectionErrors],
    seed: int = 0,
) -> tuple[float, float]:
    """Return the 95 % interval of a pressure ratio (JCGM 101:2008), NaN where it can't be known.

    Errors that sections share (walls, blur, index, voxel size) are drawn once for all vessels, own
    errors once a vessel. The drop is the power lost over the flow, Σ R q² / q₀, and changes with R
    at the flows as they are, because a shift of the flows changes it in second order only
    (Thomson's principle). What wasn't measured of a network errs like the mean of what was.

    Parameters
    ----------
    ratio : float
        Pressure drop as printed over as designed.
    resistance, flow : (v,) float64
        As printed, in any unit; closed vessels have no flow.
    vessels : sequence of SectionErrors
        One a vessel.
    """
    power = np.where(flow != 0, np.nan_to_num(resistance, posinf=0.0) * flow**2, 0.0)
    shifts = [_shift(vessel) for vessel in vessels]
    known = np.array([shift is not None for shift in shifts])
    if not np.isfinite(ratio) or not known.any() or not power.sum() > 0:
        return float("nan"), float("nan")
    usual = np.mean([shift for shift in shifts if shift is not None], axis=0)
    table = np.array([usual if shift is None else shift for shift in shifts])
    dof = next(v.wall_dof for v, shift in zip(vessels, shifts, strict=True) if shift is not None)
    rng = np.random.default_rng(seed)
    shared = rng.standard_normal((DRAWS, table.shape[1] - 1))
    shared[:, 0] = rng.standard_t(min(max(dof, 3.0), 1e6), DRAWS)
    own = rng.standard_t(OWN_DOF, (DRAWS, len(table)))
    change = np.exp(-(shared @ table[:, 1:].T) - own * table[:, 0])
    low, high = np.percentile(change @ (power / power.sum()), PERCENTILES)
    return float(ratio * low), float(ratio * high)


def _shift(vessel: SectionErrors) -> FloatArray | None:
    """Relative change of a vessel's resistance by its own and each shared standard deviation."""
    if not vessel.open.any():
        return None
    weights = vessel.resistance_weights()
    return np.concatenate([[vessel.averaged(weights)], weights @ vessel.known_shared])
