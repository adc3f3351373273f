"""Convert a comparison of several prints to CSV text, one row per vessel."""

from __future__ import annotations

from typing import Any

from registration.comparison.compare import Comparison
from registration.comparison.intervals import Interval
from registration.comparison.vessels import VesselSpread
from registration.files.exports.tables import as_csv
from registration.json_ready import json_ready


def comparison_csv(comparison: Comparison) -> str:
    """CSV; unknown numbers are empty. The last columns are each scan's error, in order."""
    return as_csv([json_ready(vessel_row(comparison, v)) for v in comparison.vessels])


def vessel_row(comparison: Comparison, vessel: VesselSpread) -> dict[str, Any]:
    """One vessel's numbers, flat."""
    error = vessel.error
    able = vessel.capability
    return {
        "vessel": vessel.vessel,
        "designed_um": vessel.designed_um,
        "prints": error.prints,
        "open": vessel.open,
        "known": vessel.known,
        **_flat("mean_error", error.mean),
        **_flat("observed_sd", error.observed_sd),
        **_flat("scan_sd", error.scan_sd),
        **_flat("print_sd", error.print_sd),
        "along_sd_um": vessel.along_sd_um,
        "profile_sd_um": vessel.profile_sd_um,
        "p_off": vessel.p_off,
        "p_beyond_others": vessel.p_beyond,
        "p_varies": vessel.p_varies,
        "drift_um_per_print": vessel.drift.slope.value if vessel.drift else None,
        "p_drift": vessel.p_drift,
        "off": vessel.off,
        "varies": vessel.varies,
        **({} if able is None else _flat("cp", able.cp, "") | _flat("cpk", able.cpk, "")),
        **{f"error_{k + 1}_um": float(scan.error_um[vessel.vessel])
           for k, scan in enumerate(comparison.scans)},
    }  # fmt: skip


def _flat(name: str, interval: Interval, unit: str = "_um") -> dict[str, float]:
    return {
        f"{name}{unit}": interval.value,
        f"{name}_low{unit}": interval.low,
        f"{name}_high{unit}": interval.high,
    }
