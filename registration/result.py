"""Result of a registration (pose, deviations, vessels, defects), and its conversion to JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.geometry.surface import Surface
from design.notebook import NotebookView
from kernels.arrays import FloatArray
from registration.alignment import AXES, AlternativePose, Uncertainty
from registration.alignment.as_printed import AsPrinted
from registration.alignment.uncertainty import quantity, terms
from registration.json_ready import json_object
from registration.measuring.gauging import ContrastGauge, Defect, Deviation, Perfusion, VesselGauge
from registration.measuring.gauging.deviation import deviation_numbers
from registration.measuring.gauging.openings.face_places import FacePlace
from registration.measuring.geometry import Characteristic, Frame
from registration.measuring.topology import Agreement, Overlap, Topology
from registration.wall_reference import WallCalibration

SIGN = "positive where the lumen, or the outside, reaches beyond the design: too little gel"
"""Of every deviation."""


@dataclass(frozen=True, repr=False)
class RegistrationReport(NotebookView):
    """Numbers of one scan against its design; frame of vertices and maps: the part's.

    Deviations are positive where the lumen (or the outside) reaches beyond the design, see
    `registration.measuring.gauging.deviation`.

    Attributes
    ----------
    transform_scan_to_part : (4, 4) float64
        Rigid map, into `frame`.
    scaled_scan_to_part : (4, 4) float64
        Map with per-axis stretch.
    scale : (3,) float64
        Size of the print over that of the design along the part's x, y, z.
    size_mm : (3,) float64, mm
        Of the design, along x, y, z.
    depth_from_index : bool
        Lengths along the light rest on a refractive index that no standard has confirmed.
    depth_scale_fitted : bool
        False: z's scale is 1 by decree, because depth couldn't be told from the index.
    offset_um : float, µm
        Uniform deviation estimated beside the scales (not taken out of any figure here).
    margin : float
        Deviation of the best wrong pose over that of the best, where the two can be told apart;
        inf when there was none.
    ambiguous : bool
        Whether anything speaks against calling the pose sure.
    doubts : tuple of str
        What does, in sentences.
    lay : str
        Which way the part lay under the light.
    depth_axis : int
        The part's axis that lies most along the light.
    rivals : tuple of AlternativePose
        Other poses that were tried, the closest first.
    uncertainty : Uncertainty
        95 % intervals of the scaled fit.
    cross_check_um : float or None, µm
        How far another program's pose moves the surface out of ours, at most; None where that
        program (small_gicp) isn't installed.
    rigid, scaled : Deviation
        Of the seen scanned surface, to the design, after each fit.
    rigid_back, scaled_back : Deviation
        Of points spread over the design's surface, to the scanned one.
    rms_interval_um : float, µm
        Half width of the 95 % interval of an RMS; NaN where it isn't known.
    hausdorff_p95_um, scaled_hausdorff_p95_um : float, µm
        The larger of both directions' 95th percentiles, rigid and scaled fit.
    model_seen_fraction : float
        Share of the design's surface whose counterpart was seen (scaled fit).
    surface : Surface
        Scanned surface after the rigid fit, facing out of the gel.
    deviation_um, scaled_deviation_um : (n,) float64, µm
        At each vertex after the rigid and the scaled fit; NaN where it wasn't seen, and everywhere
        if liquid is so bright that errors of walls aren't known.
    seen : (n,) bool
        Vertices that count.
    histogram_edges_um, histogram_counts, histogram_counts_rigid : arrays
        Of the seen vertices after the scaled and the rigid fit; the outermost bins hold what lies
        beyond.
    curve_um, curve_rigid, curve_scaled : (k,) float64
        Tolerances, and the share of the seen surface within each.
    places : tuple of FacePlace
        Where the surface away from lumens stands out, the largest first.
    frame : Frame
        How the part's frame was laid: best fit or datums.
    characteristics : tuple of Characteristic
        Position and form of axes, mouths, lumens and outer faces, in that frame.
    vessels : tuple of VesselGauge
        One each, in the network's order.
    all_open : bool
        Every vessel was seen from end to end and is open.
    defects : tuple of Defect
        By vessel and place.
    topology : Topology
        How the lumens hang together.
    agreement : Agreement
        Of the scan's hollows and surface with the design: whether it is of this part at all.
    as_printed : AsPrinted
        Where the print ended early or layers were shifted: the pose is that of the rest.
    overlap_rigid, overlap_scaled : Overlap
        Dice and volume ratio of the lumens after each fit.
    perfusion : Perfusion or None
        Flow through the lumens as printed; None where the design itself has none.
    contrast : ContrastGauge
        How well gel and liquid are told apart.
    needed_voxel_um : float, µm
        Largest voxel that would show the thinnest lumen; NaN where the scan's do.
    gel_at : (p,) float64 or None
        At each of `RegistrationOptions.places_mm`, after the scaled fit: 1 for gel, 0 for none, NaN
        outside of the scan's field or where too little light came to tell; None where nobody asked.
    walls : WallCalibration or None
        What was taken out of every wall.
    notes : tuple of str
        What a reader must know.
    """

    transform_scan_to_part: FloatArray
    scaled_scan_to_part: FloatArray
    scale: FloatArray
    size_mm: FloatArray
    depth_from_index: bool
    depth_scale_fitted: bool
    offset_um: float
    margin: float
    ambiguous: bool
    doubts: tuple[str, ...]
    lay: str
    depth_axis: int
    rivals: tuple[AlternativePose, ...]
    uncertainty: Uncertainty
    cross_check_um: float | None
    rigid: Deviation
    scaled: Deviation
    rigid_back: Deviation
    scaled_back: Deviation
    rms_interval_um: float
    hausdorff_p95_um: float
    scaled_hausdorff_p95_um: float
    model_seen_fraction: float
    surface: Surface
    deviation_um: FloatArray
    scaled_deviation_um: FloatArray
    seen: NDArray[np.bool_]
    histogram_edges_um: FloatArray
    histogram_counts: NDArray[np.int64]
    histogram_counts_rigid: NDArray[np.int64]
    curve_um: FloatArray
    curve_rigid: FloatArray
    curve_scaled: FloatArray
    places: tuple[FacePlace, ...]
    frame: Frame
    characteristics: tuple[Characteristic, ...]
    vessels: tuple[VesselGauge, ...]
    all_open: bool
    defects: tuple[Defect, ...]
    topology: Topology
    agreement: Agreement
    as_printed: AsPrinted
    overlap_rigid: Overlap
    overlap_scaled: Overlap
    perfusion: Perfusion | None
    contrast: ContrastGauge
    needed_voxel_um: float
    gel_at: FloatArray | None
    walls: WallCalibration | None
    notes: tuple[str, ...]

    def _facts(self) -> Mapping[str, str]:
        closed = sum(vessel.open is False for vessel in self.vessels)
        return {
            "deviation": f"RMS {self.scaled.rms_um:.4g} µm",
            "scale": " × ".join(f"{one:.4f}" for one in self.scale),
            "vessels": f"{len(self.vessels)}, {closed} closed, {len(self.defects)} defects",
            "pose": "ambiguous" if self.ambiguous else "sure",
        }

    def _columns(self) -> Mapping[str, Any]:
        rows = report_dict(self)["vessels"]
        first = rows[0] if rows else {}
        names = [name for name, value in first.items() if not isinstance(value, list | dict)]
        return {name: [row[name] for row in rows] for name in names}

    def _draw(self, axes: Any) -> None:
        axes.stairs(self.histogram_counts, self.histogram_edges_um, fill=True)
        axes.set_xlabel("deviation of the surface (µm)")
        axes.set_ylabel("vertices")


def scaled_vertices(report: RegistrationReport) -> FloatArray:
    """Vertices of the scanned surface after the scaled fit, (n, 3), mm, as files hold them."""
    again = report.scaled_scan_to_part @ np.linalg.inv(report.transform_scan_to_part)
    vertices = report.surface.vertices @ again[:3, :3].T + again[:3, 3]
    return vertices.astype(np.float32).astype(np.float64)


def report_dict(report: RegistrationReport) -> dict[str, Any]:
    """JSON-ready numbers (no mesh); what isn't known or finite is None."""
    plain: dict[str, object] = {
        "rigid": deviation_numbers(report.rigid),
        "scaled": deviation_numbers(report.scaled),
        "transform_scan_to_part": report.transform_scan_to_part.tolist(),
        "scaled_scan_to_part": report.scaled_scan_to_part.tolist(),
        "scale": report.scale.tolist(),
        "size_mm": report.size_mm.tolist(),
        "depth_from_index": report.depth_from_index,
        "depth_scale_fitted": report.depth_scale_fitted,
        "offset_um": report.offset_um,
        "interval_95": {
            "rotation_deg": report.uncertainty.rotation_deg.tolist(),
            "shift_um": (1e3 * report.uncertainty.shift_mm).tolist(),
            "scale": report.uncertainty.scale.tolist(),
            "offset_um": 1e3 * report.uncertainty.offset_mm,
        },
        "budget": _budget(report),
        "cross_check_um": report.cross_check_um,
        "ambiguity": {
            "margin": report.margin,
            "flag": report.ambiguous,
            "doubts": list(report.doubts),
            "rivals": [_rival_dict(rival) for rival in report.rivals],
        },
        "lay": {"words": report.lay, "depth_axis": AXES[report.depth_axis]},
        "histogram": {
            "edges_um": report.histogram_edges_um.tolist(),
            "counts": report.histogram_counts.tolist(),
            "counts_rigid": report.histogram_counts_rigid.tolist(),
        },
        "rigid_model_to_scan": deviation_numbers(report.rigid_back),
        "scaled_model_to_scan": deviation_numbers(report.scaled_back),
        "rms_interval_95_um": report.rms_interval_um,
        "hausdorff_p95_um": {
            "rigid": report.hausdorff_p95_um,
            "scaled": report.scaled_hausdorff_p95_um,
        },
        "model_seen_fraction": report.model_seen_fraction,
        "within_curve": {
            "tolerance_um": report.curve_um.tolist(),
            "rigid": _rounded(report.curve_rigid, 5),
            "scaled": _rounded(report.curve_scaled, 5),
        },
        "overlap": {"rigid": asdict(report.overlap_rigid), "scaled": asdict(report.overlap_scaled)},
        "topology": _topology_dict(report.topology),
        "agreement": {
            **asdict(report.agreement),
            "likelihood": report.agreement.likelihood,
            "other_part": report.agreement.other_part,
        },
        "as_printed": _as_printed_dict(report.as_printed),
        "contrast": {
            "liquid": report.contrast.liquid,
            "untold": report.contrast.untold,
            "examined": report.contrast.examined,
            "blur_um": report.contrast.blur_um,
            "leak_um": report.contrast.leak_um,
        },
        "needed_voxel_um": report.needed_voxel_um,
        "perfusion": None if report.perfusion is None else _perfusion_dict(report.perfusion),
        "frame": _frame_dict(report.frame),
        "characteristics": [_characteristic_dict(one) for one in report.characteristics],
        "vessels": [_vessel_dict(vessel) for vessel in report.vessels],
        "all_open": report.all_open,
        "defects": [asdict(defect) for defect in report.defects],
        "walls": None if report.walls is None else asdict(report.walls),
        "notes": list(report.notes),
    }
    return json_object(plain)


_DECIMALS = {
    "along_mm": 4,
    "diameter_um": 2,
    "area_mm2": 6,
    "ovality_along": 4,
    "offset_along_um": 2,
    "noise_um": 2,
    "shift_along_um": 2,
    "designed_along_um": 2,
    "place_mm": 4,
    "interval_95_um": 2,
}
"""Of the numbers along a vessel: far below what they are good for, and half the file."""


_INTERVALS = {
    "u_um": "interval_95_um",
    "measured_u_um": "measured_interval_95_um",
    "offset_u_um": "offset_interval_95_um",
    "oval_u_um": "oval_interval_95_um",
    "resistance_ratio_95": "resistance_ratio_interval_95",
}
"""Names of a vessel's 95 % intervals in JSON: half widths, but for the last, which has ends."""


def _budget(report: RegistrationReport) -> list[dict[str, object]]:
    """Budgets of the pose's scales and offset, and of the vessel whose interval is the median."""
    known = [vessel for vessel in report.vessels if math.isfinite(vessel.measured_u_um)]
    rows = [
        quantity(name, "um", budget, 1e3) if name == "offset" else quantity(name, "%", budget, 1e2)
        for name, budget in report.uncertainty.budgets.items()
    ]
    if known:
        middle = sorted(known, key=lambda vessel: vessel.measured_u_um)[len(known) // 2]
        rows.append(quantity(f"diameter of vessel {middle.vessel}", "um", middle.budget, 1e3))
    return rows


def _vessel_dict(vessel: VesselGauge) -> dict[str, object]:
    plain = {f.name: getattr(vessel, f.name) for f in fields(vessel)}
    for name in ("budget", "errors", "outlines"):
        del plain[name]
    for name, interval in _INTERVALS.items():
        plain[interval] = plain.pop(name)
    plain["resistance_ratio_interval_95"] = list(plain["resistance_ratio_interval_95"])
    plain["budget"] = terms(vessel.budget, 1e3)
    for name, decimals in _DECIMALS.items():
        plain[name] = _rounded(plain[name], decimals)
    return plain


def _frame_dict(frame: Frame) -> dict[str, object]:
    return {
        "datums": list(frame.names),
        "words": frame.words,
        "places": [
            {"datum": name, "interval_95_um": round(u, 2), "from_best_fit_um": round(moved, 2)}
            for name, u, moved in frame.places
        ],
    }


def _characteristic_dict(one: Characteristic) -> dict[str, object]:
    return {
        "characteristic": one.words,
        "name": one.name,
        "feature": one.feature,
        "vessel": one.vessel,
        "zone_um": round(one.zone_um, 2),
        "interval_95_um": [round(one.low_um, 2), round(one.high_um, 2)],
        "seen_fraction": round(one.seen, 4),
        "note": one.note,
    }


def _rival_dict(rival: AlternativePose) -> dict[str, object]:
    return {
        "motion": rival.motion,
        "mirrored": rival.mirrored,
        "lead": rival.lead,
        "differs_um": rival.apart_um,
        "same": rival.same,
        "differs_at_mm": np.round(rival.place_mm, 3).tolist(),
        "seen_there": rival.seen,
        "vessels": list(rival.vessels),
    }


def _as_printed_dict(printed: AsPrinted) -> dict[str, object]:
    shift = printed.shift
    return {
        "ends_mm": printed.ends_mm,
        "missing_mm": printed.missing_mm,
        "shift": shift
        and {
            "from_mm": shift.from_mm,
            "to_mm": shift.to_mm,
            "shift_um": (1e3 * shift.shift_mm).round(1).tolist(),
            "interval_95_um": (1e3 * shift.interval_mm).round(1).tolist(),
        },
    }


def _topology_dict(topology: Topology) -> dict[str, object]:
    plain = asdict(topology)
    for name in ("designed", "drawn", "printed", "expected"):
        plain[name]["euler"] = getattr(topology, name).euler
    return plain


def _perfusion_dict(flow: Perfusion) -> dict[str, object]:
    return {
        "perfused": flow.perfused,
        "inflow_ul_s": flow.inflow_ul_s,
        "pressure_drop_pa": flow.pressure_drop_pa,
        "designed_pressure_drop_pa": flow.designed_pressure_drop_pa,
        "pressure_ratio": flow.pressure_ratio,
        "pressure_ratio_interval_95": list(flow.pressure_ratio_95),
        "vessels": [
            {
                "vessel": vessel,
                "resistance_pa_s_ul": float(flow.resistance_pa_s_ul[vessel]),
                "designed_resistance_pa_s_ul": float(flow.designed_resistance_pa_s_ul[vessel]),
                "flow_ul_s": float(flow.flow_ul_s[vessel]),
                "designed_flow_ul_s": float(flow.designed_flow_ul_s[vessel]),
                "share": float(flow.share[vessel]),
                "designed_share": float(flow.designed_share[vessel]),
                "measured": bool(flow.measured[vessel]),
                "fed": bool(flow.fed[vessel]),
            }
            for vessel in range(len(flow.share))
        ],
    }


def _rounded(values: FloatArray, decimals: int) -> list[float]:
    rounded: list[float] = np.round(values, decimals).tolist()
    return rounded
