"""95 % intervals of flow as printed, by drawing lumens within their measured errors (0D)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final

import numpy as np
from scipy.special import ndtri

from design.hemodynamics import FlowConditions
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from printctl.analysis.flow.as_printed import OpenPart
from printctl.analysis.flow.printed_fidelities import FlowIntervals, VesselFlow, lumped

DRAWS: Final = 400
PERCENTILES: Final = (2.5, 97.5)
_K: Final = float(ndtri(0.975))


@dataclass(frozen=True)
class LumenErrors:
    """Relative standard uncertainty of each vessel's radius, as it conducts; (v,) each.

    Attributes
    ----------
    shared : float64
        What errs alike in all vessels (type B: walls, index, voxel size).
    own : float64
        What doesn't (type A).
    known : bool
        False where a measured diameter's interval was withdrawn, or an older registration has
        none: no flow of the network has an interval then.
    """

    shared: FloatArray
    own: FloatArray
    known: bool


def lumen_errors(rows: Sequence[Mapping[str, Any]]) -> LumenErrors:
    """Read the errors of a registration's vessels from their resistances' intervals.

    R goes as r⁻⁴, so that a relative error of r is a quarter of R's. A vessel that wasn't measured
    is taken as wide as the others' median error makes it: it errs as they do in the mean, and by
    their scatter about it besides.

    Parameters
    ----------
    rows : sequence of mapping
        ``vessels`` of registration.json.
    """
    relative = np.array([_relative(row) for row in rows])
    part = np.array([_shared_part(row) for row in rows])
    measured = np.array([any(row.get("diameter_um") or ()) for row in rows])
    known = bool(np.isfinite(relative[measured]).all()) and bool(measured.any())
    if not known:
        return LumenErrors(np.zeros(len(rows)), np.zeros(len(rows)), False)
    shared, own = relative * np.sqrt(part), relative * np.sqrt(1.0 - part)
    off = [0.01 * row["error_percent"] for row in rows if row.get("error_percent") is not None]
    scatter = float(np.std(off, ddof=1)) if len(off) > 1 else 0.0
    usual = float(np.mean(shared[measured]))
    guessed = float(np.hypot(np.mean(own[measured]), scatter))
    return LumenErrors(np.where(measured, shared, usual), np.where(measured, own, guessed), True)


def _relative(row: Mapping[str, Any]) -> float:
    """Relative standard uncertainty of a vessel's radius; NaN without an interval."""
    ends = row.get("resistance_ratio_interval_95") or [None, None]
    if None in ends or min(ends) <= 0:
        return float("nan")
    return float(np.log(ends[1] / ends[0]) / (2 * _K) / 4)


def _shared_part(row: Mapping[str, Any]) -> float:
    """Share of a vessel's variance that all vessels have in common; all of it where unknown."""
    terms = row.get("budget") or []
    if not terms:
        return 1.0
    return float(np.clip(sum(t["share"] for t in terms if t["type"] == "B"), 0.0, 1.0))


def flow_intervals(
    part: OpenPart, conditions: FlowConditions, errors: LumenErrors, count: int, seed: int = 0
) -> FlowIntervals | None:
    """Draw lumens within their errors and solve 0D flow in each (JCGM 101:2008).

    Parameters
    ----------
    part : OpenPart
        What flow can run through.
    conditions : FlowConditions
        Of that part.
    errors : LumenErrors
        Of the design's vessels.
    count : int
        Vessels of the design.
    seed : int

    Returns
    -------
    FlowIntervals or None
        By the design's numbers; None where a lumen's interval isn't known.

    Raises
    ------
    FlowError
        As `solve_flow`.
    """
    if not errors.known:
        return None
    rng = np.random.default_rng(seed)
    alike = rng.standard_normal(DRAWS)
    apart = rng.standard_normal((DRAWS, len(part.vessel)))
    shared, own = errors.shared[part.vessel], errors.own[part.vessel]
    factors = np.exp(alike[:, None] * shared + apart * own)
    drawn = [
        lumped(_widened(part.network, factor), conditions).of_design(part, count)
        for factor in factors
    ]
    names = [f.name for f in fields(FlowIntervals)]
    return FlowIntervals(*(_ends([getattr(one, name) for one in drawn]) for name in names))


def _widened(network: VesselNetwork, factor: FloatArray) -> VesselNetwork:
    return replace(network, radius=network.radius * np.repeat(factor, np.diff(network.offset)))


def _ends(values: Sequence[Any]) -> FloatArray:
    with np.errstate(invalid="ignore"):  # closed vessels resist without end in every draw
        low, high = np.percentile(np.array(values), PERCENTILES, axis=0, method="nearest")
    return np.array([low, high])


def carry_intervals(
    intervals: FlowIntervals, lumped_flow: VesselFlow, other: VesselFlow
) -> FlowIntervals:
    """Intervals of another fidelity: the lumped one's, relative to its value, about the other's.

    Shares keep the width of theirs, because a share may be nothing.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        made = {
            name: getattr(intervals, name) / getattr(lumped_flow, name) * getattr(other, name)
            for name in ("resistance", "flow", "wall_shear", "drop_pa", "inflow_ul_s")
        }
    made["flow"] = np.sort(made["flow"], axis=0)
    return FlowIntervals(**made, share=intervals.share - lumped_flow.share + other.share)
