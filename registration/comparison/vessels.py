"""Per vessel over several prints: diameter error, spread, drift, number found open, capability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from kernels.arrays import FloatArray
from registration.comparison.scans import GaugedScan
from registration.comparison.statistics import (
    Capability,
    Components,
    Trend,
    capability,
    components,
    holm,
    mean_p,
    trend,
)

SIGNIFICANT = 0.05


@dataclass(frozen=True)
class VesselSpread:
    """One vessel's diameter error over the prints, µm.

    Attributes
    ----------
    vessel : int
    designed_um : float, µm
    error : Components
        Of measured less designed diameter.
    along_sd_um : float, µm
        Along the vessel, of what isn't the same in every scan (each scan's mean and the profile
        common to all taken out): within-print variation. NaN without common sections.
    profile_sd_um : float, µm
        Along the vessel, of the profile that all scans share, a designed taper included.
    open : int
        Prints in which it was open, of `known`.
    known : int
        Prints in which it was seen to be open or closed.
    p_off, p_beyond, p_varies, p_drift : float
        After Holm's correction for the number of vessels: of a mean error that is zero; of one
        that is what all vessels share; of varying no more than the others; of no trend.
    drift : Trend or None
        Change of the error from print to print.
    capability : Capability or None
        Where a tolerance was set.
    """

    vessel: int
    designed_um: float
    error: Components
    along_sd_um: float
    profile_sd_um: float
    open: int
    known: int
    p_off: float
    p_beyond: float
    p_varies: float
    p_drift: float
    drift: Trend | None
    capability: Capability | None

    @property
    def off(self) -> bool:
        """Whether its mean differs from zero by more than chance among so many vessels."""
        return self.p_off < SIGNIFICANT

    @property
    def varies(self) -> bool:
        """Whether it varies more than the others by more than chance."""
        return self.p_varies < SIGNIFICANT


def vessel_spreads(
    scans: Sequence[GaugedScan], prints: Sequence[int], tolerance_percent: float | None
) -> tuple[VesselSpread, ...]:
    """Every vessel over the prints.

    Parameters
    ----------
    scans : sequence of GaugedScan
        In the order of their prints.
    prints : sequence of int
        The print that each is a scan of, counted from 0.
    tolerance_percent : float or None
        Of the diameter.
    """
    error = np.array([scan.error_um for scan in scans])
    parts = [components(column, prints) for column in error.T]
    means = np.array([part.print_means for part in parts])
    drifts = [trend(range(means.shape[1]), row) for row in means]
    p_off = holm([mean_p(_known(row)) for row in means])
    p_beyond = holm([mean_p(_known(row)) for row in beyond_common(means)])
    p_varies = holm(_variance_p(means))
    p_drift = holm([np.nan if drift is None else drift.p for drift in drifts])
    along = [_along(scans, v) for v in range(len(parts))]
    openness = [_openness(scans, prints, v) for v in range(len(parts))]
    return tuple(
        VesselSpread(
            vessel=v,
            designed_um=float(scans[0].designed_um[v]),
            error=parts[v],
            along_sd_um=along[v][0],
            profile_sd_um=along[v][1],
            open=sum(openness[v]),
            known=len(openness[v]),
            p_off=float(p_off[v]),
            p_beyond=float(p_beyond[v]),
            p_varies=float(p_varies[v]),
            p_drift=float(p_drift[v]),
            drift=drifts[v],
            capability=_capability(parts[v], scans[0].designed_um[v], tolerance_percent),
        )
        for v in range(len(parts))
    )


def _known(values: FloatArray) -> FloatArray:
    return values[np.isfinite(values)]


def beyond_common(means: FloatArray) -> FloatArray:
    """(v, p) errors less what all vessels of a print share: the median of its vessels."""
    shared = [float(np.median(_known(column))) if np.isfinite(column).any() else np.nan
              for column in means.T]  # fmt: skip
    return means - np.array(shared)


def _variance_p(means: FloatArray) -> list[float]:
    """Of each vessel: chance of a variance over prints so much above the others' pooled one.

    A print's shift of all vessels is taken out first, so that one bad print isn't every
    vessel's fault. One-sided F test (Fisher).
    """
    rest = beyond_common(means)
    count = np.isfinite(rest).sum(axis=1)
    df = np.maximum(count - 1, 0)
    middle = np.array([_known(row).mean() if len(_known(row)) else np.nan for row in rest])
    squares = np.nansum((rest - middle[:, None]) ** 2, axis=1)
    chances = []
    for v in range(len(rest)):
        others_df, others = df.sum() - df[v], squares.sum() - squares[v]
        if df[v] < 1 or others_df < 2 or others <= 0:
            chances.append(np.nan)
            continue
        ratio = (squares[v] / df[v]) / (others / others_df)
        chances.append(float(stats.f.sf(ratio, df[v], others_df)))
    return chances


def _along(scans: Sequence[GaugedScan], vessel: int) -> tuple[float, float]:
    """Spread along a vessel over the sections that all scans share: of each scan, and of all."""
    diameters = [dict(zip(np.round(along, 4).tolist(), diameter.tolist(), strict=True))
             for along, diameter in (scan.sections[vessel] for scan in scans)]  # fmt: skip
    diameters = [{x: d for x, d in one.items() if np.isfinite(d) and d > 0} for one in diameters]
    diameters = [one for one in diameters if one]
    places = sorted(set.intersection(*map(set, diameters))) if len(diameters) > 1 else []
    if len(places) < 2:
        return float("nan"), float("nan")
    table = np.array([[one[x] for x in places] for one in diameters])
    profile = table.mean(axis=0)
    rest = table - table.mean(axis=1, keepdims=True) - profile + profile.mean()
    df = (table.shape[0] - 1) * (table.shape[1] - 1)
    return float(np.sqrt((rest**2).sum() / df)), float(profile.std(ddof=1))


def _openness(scans: Sequence[GaugedScan], prints: Sequence[int], vessel: int) -> list[bool]:
    """Of each print that tells; where any scan shows it closed, it is closed in that print."""
    is_open: dict[int, bool] = {}
    for scan, number in zip(scans, prints, strict=True):
        state = scan.open[vessel]
        if state is not None:
            is_open[number] = is_open.get(number, True) and state
    return list(is_open.values())


def _capability(part: Components, designed_um: float, percent: float | None) -> Capability | None:
    if percent is None:
        return None
    return capability(part.mean.value, part.observed_sd, designed_um * percent / 100)
