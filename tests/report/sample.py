"""Sample report.json contents, made up but consistent."""

from dataclasses import replace
from typing import Any

import numpy as np
from skimage.measure import marching_cubes

from design.geometry.surface import Surface
from design.network import VesselKind, VesselNetwork
from report import ReportSurface
from tests.registration import parts


def planar_network() -> VesselNetwork:
    """Inlet, two headers in three pieces, four channels, outlet; block of 16 × 8 × 3 mm."""
    kind = np.full(14, VesselKind.CHANNEL, dtype=np.int64)
    kind[[0, -1]] = VesselKind.ARTERY, VesselKind.VEIN
    return replace(parts.planar_network(), kind=kind)


def deviation_surface(spacing: float = 0.2) -> ReportSurface:
    """The lumens' wall with a smooth, wavy deviation of some tens of µm."""
    low, high = np.array([-0.2, 0.2, 0.7]), np.array([16.2, 8.0, 2.3])
    axes = [np.arange(a, b, spacing) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    field = parts.lumen_distance(planar_network(), grid)
    vertices, faces, _, _ = marching_cubes(field, 0.0, spacing=(spacing,) * 3)
    vertices = vertices.astype(np.float64) + low
    x, y, z = vertices.T
    wave = 30 * np.sin(0.8 * x + 0.5 * y) + 45 * (z - 1.5) + 18 * np.sin(5 * x) * np.cos(4 * y)
    noise = np.random.default_rng(1).normal(0.0, 5.0, len(x))
    scalar = wave + noise - 6.0
    scalar[(x > 12.2) & (y > 7.0) & (z < 1.3)] = np.nan
    surface = Surface(vertices, faces)
    return ReportSurface("Signed deviation, rigid", surface, scalar, "µm", (-100, 100))


def block_surface() -> ReportSurface:
    """The block without its lumens, as the setting of the others."""
    corners = np.array([[x, y, z] for x in (0, 16) for y in (0, 8) for z in (0, 3)], float)
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
             [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]  # fmt: skip
    return ReportSurface("Block, as designed", Surface(corners, np.array(faces)))


def sample_data() -> dict[str, Any]:
    """Every section of report.json."""
    network = planar_network()
    vessels, flow = vessel_records(network)
    return {
        "schema": 1,
        "recipe": "planar_fresh",
        "verdict": {
            "passed": True,
            "reasons": [
                "Every vessel is open.",
                "Largest diameter error 6.3 % of 10 % allowed (vessel 5).",
                "RMS deviation 38.2 µm of 100 µm allowed, rigid fit.",
            ],
        },
        "frames": {
            "tissue": {"origin": "corner of the block", "unit": "mm", "handed": "right"},
            "part": {"same_as": "tissue"},
            "printer": {"from": "part", "place_mm": [102.0, 96.0, 0.2]},
            "scan": {
                "from": "printer",
                "axes": "x fast, y slow, z down",
                "voxel_um": [8.0, 10.0, 10.0],
                "matrix": [[1.0, 0, 0, 0.31], [0, -1.0, 0, 8.2], [0, 0, -1.0, 3.4], [0, 0, 0, 1]],
            },
        },
        "tissue": {"name": "block", "volume_mm3": 384.0, "extent_mm": [16.0, 8.0, 3.0]},
        "network": {
            "vessels": network.vessel_count,
            "terminals": 1,
            "length_mm": float(network.lengths().sum()),
            "volume_mm3": 24.31,
            "diameter_min_mm": 0.4,
            "diameter_max_mm": 1.0,
        },
        "flow": {
            "inlet_flow_ml_min": 0.25,
            "pressure_drop_mmhg": 0.093,
            "wall_shear_min_pa": 0.012,
            "wall_shear_max_pa": 0.27,
            "reynolds_max": 1.41,
            "vessels": flow,
        },
        "solid": {"volume_mm3": 359.7, "genus": 3, "watertight": True, "triangles": 18244},
        "toolpath": {
            "method": "fresh", "layers": 50, "lines": 18422, "written_ul": 359.1,
            "length_mm": 39870.2,
        },
        "dry_run": _dry_run(),
        "print": {
            "printer": "lulzbot_replistruder (simulated)", "port": "/dev/pts/3",
            "state": "finished", "lines": 18422, "duration_s": 4390.7,
        },
        "scan": {
            "source": "simulated OCT", "modality": "oct", "voxel_um": [8.0, 10.0, 10.0],
            "shape": [420, 860, 1680],
        },
        "registration": _registration(vessels),
        "truth_check": {"pose_error_um": 8.4, "rotation_error_deg": 0.04},
        "timings": {
            name: {"seconds": s, "peak_mb": mb, "reused": reused}
            for name, s, mb, reused in (
                ("tissue", 0.2, 160, True), ("vasculature", 0.1, 162, True),
                ("flow", 0.05, 165, True), ("solid", 1.9, 240, False),
                ("toolpath", 2.4, 310, False), ("dry run", 3.2, 420, False),
                ("print", 11.8, 510, False), ("scan", 14.0, 2210, False),
                ("registration", 21.7, 3100, False), ("report", 1.8, 640, False),
            )
        },
        "provenance": {
            "versions": {"printctl": "0.1.0", "numpy": "2.4.6", "python": "3.11.2"},
            "inputs": {"planar_fresh.yaml": "6f1c0f9c4f…", "lulzbot.yaml": "a19be2d07c…"},
            "seed": 1,
        },
    }  # fmt: skip


def _dry_run() -> dict[str, Any]:
    return {
        "duration_s": 4382.1,
        "checks": [
            {"check": "inside the printer's bounds", "value": 118.0, "limit": 190.0,
             "unit": "mm", "passed": True, "place": None},
            {"check": "feed", "value": 20.0, "limit": 30.0, "unit": "mm/s", "passed": True,
             "place": "line 212"},
            {"check": "syringe volume", "value": 361.4, "limit": 2500.0, "unit": "µL",
             "passed": True, "place": "lulzbot.yaml: syringe"},
        ],
    }  # fmt: skip


def _registration(vessels: list[dict[str, Any]]) -> dict[str, Any]:
    counts, edges = np.histogram(deviation_surface(0.4).scalar, bins=40, range=(-120, 120))
    return {
        "rigid": {"rms_um": 38.2, "mean_um": -6.1, "median_um": -5.4, "sd_um": 37.7,
                  "p95_um": 74.9, "within": {"25": 0.482, "50": 0.811, "100": 0.996}},
        "scaled": {"rms_um": 21.3, "mean_um": -0.4, "median_um": -0.2, "sd_um": 21.3,
                   "p95_um": 42.0, "within": {"25": 0.761, "50": 0.978, "100": 1.0}},
        "transform_scan_to_part": [[0.99991, 0.0123, 0.0041, -0.3121],
                                   [0.0122, -0.99989, 0.0083, 8.2034],
                                   [0.0042, -0.0082, -0.99996, 3.4011], [0, 0, 0, 1]],
        "scale": [0.9962, 0.9958, 0.9981],
        "ambiguity": {"margin": 0.42, "flag": False},
        "histogram": {"edges_um": edges.tolist(), "counts": counts.tolist()},
        "vessels": vessels,
        "notes": ["Depth and refractive index can't be told apart without a depth standard; "
                  "depth isn't compensated."],
    }  # fmt: skip


def vessel_records(
    network: VesselNetwork,
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Gauged vessels and their flow."""
    random = np.random.default_rng(7)
    gauged, flow = [], []
    for i, (radius, length) in enumerate(
        zip(network.mean_radius(), network.lengths(), strict=True)
    ):
        designed = 2000.0 * float(radius)
        error = float(random.normal(-2.0, 2.5))
        kind = VesselKind(int(network.kind[i])).name.lower()
        gauged.append({
            "vessel": i, "kind": kind, "designed_um": designed,
            "measured_um": designed * (1 + error / 100), "error_percent": error,
            "narrowest_um": designed * (1 + error / 100) * 0.93, "open": True,
            "offset_um": float(abs(random.normal(0, 14))), "rms_um": float(random.uniform(18, 50)),
            "length_mm": float(length), "seen_fraction": float(random.uniform(0.85, 1.0)),
        })  # fmt: skip
        flow.append({
            "vessel": i, "kind": kind, "diameter_mm": designed / 1000, "length_mm": float(length),
            "flow_ml_min": float(0.25 * (radius / 0.5) ** 4), "pressure_in_mmhg": 0.093 - 0.005 * i,
            "pressure_out_mmhg": 0.088 - 0.005 * i, "wall_shear_pa": 0.12, "velocity_mm_s": 5.3,
        })  # fmt: skip
    return gauged, flow
