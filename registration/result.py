"""What a registration found, and its JSON form."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from registration.gauging import Deviation, VesselGauge

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class RegistrationReport:
    """Numbers of one scan against its design; frame of vertices and maps: the part's.

    Deviations are positive where the lumen (or the outside) reaches beyond the design, see
    `registration.gauging.deviation`.

    Attributes
    ----------
    transform_scan_to_part : (4, 4) float64
        Rigid map.
    scaled_scan_to_part : (4, 4) float64
        Map with per-axis stretch.
    scale : (3,) float64
        Size of the print over that of the design along the part's x, y, z.
    depth_scale_fitted : bool
        False: z's scale is 1 by decree, because depth couldn't be told from the index.
    offset_um : float, µm
        Uniform deviation estimated beside the scales (not taken out of any figure here).
    margin : float
        Deviation of the best wrong pose over that of the best, where the two can be told apart;
        inf when there was none.
    ambiguous : bool
        Margin too small to be sure of the pose.
    rigid, scaled : Deviation
        Of the seen surface after each fit.
    vertices : (n, 3) float64, mm
        Scanned surface after the rigid fit.
    faces : (m, 3) int32
        Facing out of the gel.
    deviation_um, scaled_deviation_um : (n,) float64, µm
        At each vertex after the rigid and the scaled fit.
    seen : (n,) bool
        Vertices that count.
    histogram_edges_um, histogram_counts, histogram_counts_rigid : arrays
        Of the seen vertices after the scaled and the rigid fit; the outermost bins hold what lies
        beyond.
    vessels : tuple of VesselGauge
        One each, in the network's order.
    all_open : bool
        Every vessel that was seen is open, and at least one was seen.
    notes : tuple of str
        What a reader must know.
    """

    transform_scan_to_part: FloatArray
    scaled_scan_to_part: FloatArray
    scale: FloatArray
    depth_scale_fitted: bool
    offset_um: float
    margin: float
    ambiguous: bool
    rigid: Deviation
    scaled: Deviation
    vertices: FloatArray
    faces: NDArray[np.int32]
    deviation_um: FloatArray
    scaled_deviation_um: FloatArray
    seen: NDArray[np.bool_]
    histogram_edges_um: FloatArray
    histogram_counts: NDArray[np.int64]
    histogram_counts_rigid: NDArray[np.int64]
    vessels: tuple[VesselGauge, ...]
    all_open: bool
    notes: tuple[str, ...]


def report_dict(report: RegistrationReport) -> dict[str, Any]:
    """JSON-ready numbers (no mesh); what isn't known or finite is None."""
    plain: dict[str, Any] = {
        "rigid": asdict(report.rigid),
        "scaled": asdict(report.scaled),
        "transform_scan_to_part": report.transform_scan_to_part.tolist(),
        "scaled_scan_to_part": report.scaled_scan_to_part.tolist(),
        "scale": report.scale.tolist(),
        "depth_scale_fitted": report.depth_scale_fitted,
        "offset_um": report.offset_um,
        "ambiguity": {"margin": report.margin, "flag": report.ambiguous},
        "histogram": {
            "edges_um": report.histogram_edges_um.tolist(),
            "counts": report.histogram_counts.tolist(),
            "counts_rigid": report.histogram_counts_rigid.tolist(),
        },
        "vessels": [_vessel_dict(vessel) for vessel in report.vessels],
        "all_open": report.all_open,
        "notes": list(report.notes),
    }
    cleaned: dict[str, Any] = _clean(plain)
    return cleaned


def _vessel_dict(vessel: VesselGauge) -> dict[str, Any]:
    plain = asdict(vessel)
    plain["along_mm"] = vessel.along_mm.tolist()
    plain["diameter_um"] = vessel.diameter_um.tolist()
    return plain


def _clean(value: Any) -> Any:
    """The same with string keys and None for NaN and infinity, which JSON has not."""
    if isinstance(value, dict):
        return {str(key): _clean(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_clean(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
