"""Findings of the checkers in one exported network, as rows."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers import (
    Coverage,
    Outside,
    Perfusion,
    consistent_radii,
    coverage,
    murray_ratios,
    near_pairs,
    outlet_flows,
    pieces_outside,
    read_network,
    read_stl,
    spread,
    total_volume,
)
from benchmarks.machine import row

CLEARANCE_RATIO = 0.1
DROP_PA = 40 * 133.322
VISCOSITY_PA_S = 4e-3


@dataclass(frozen=True)
class Found:
    """Measures of one exported network."""

    segments: int
    terminals: int
    colliding_pairs: int
    first_colliding: list[list[int]]
    deepest_collision_mm: float
    overlaps_within_joints: int
    overlaps_percent: float
    segments_outside: int
    first_outside: list[tuple[int, float | None]]
    """Up to five: piece, how far its lumen reaches out (mm; None where its axis does)."""
    flow_spread: float
    inflow_ul_s: float
    murray_low: float
    murray_high: float
    volume_mm3: float
    consistent_volume_mm3: float
    radius_error: float
    """Largest relative difference between the file's radii and consistent ones."""

    coverage: Coverage

    @property
    def murray_residual(self) -> float:
        """Largest relative departure of Σ r³ from the parent's."""
        return max(1.0 - self.murray_low, self.murray_high - 1.0)


def check(path: Path, stl: Path, flow_ul_s: float) -> Found:
    """Run all checkers on an exported file and its tissue's STL."""
    net = read_network(path)
    near = near_pairs(net, clearance_ratio=CLEARANCE_RATIO)
    tissue = read_stl(stl)
    outside = pieces_outside(net, tissue)
    flows = outlet_flows(net, DROP_PA, VISCOSITY_PA_S)
    ratios = murray_ratios(net)
    radius = consistent_radii(net, Perfusion(flow_ul_s, DROP_PA, VISCOSITY_PA_S))
    return Found(
        segments=net.count,
        terminals=len(net.outlets()),
        colliding_pairs=len(near.colliding),
        first_colliding=near.colliding[:5].tolist(),
        deepest_collision_mm=float(np.abs(near.gap[~near.joint].min(initial=0.0))),
        overlaps_within_joints=len(near.within_joints),
        overlaps_percent=100.0 * len(near.within_joints) / net.count,
        segments_outside=len(outside.pieces),
        first_outside=_first(outside),
        flow_spread=spread(flows),
        inflow_ul_s=float(flows.sum()),
        murray_low=float(ratios.min(initial=1.0)),
        murray_high=float(ratios.max(initial=1.0)),
        volume_mm3=total_volume(net),
        consistent_volume_mm3=total_volume(net, radius),
        coverage=coverage(net, tissue),
        radius_error=float(np.abs(net.radius / radius[:, None] - 1.0).max()),
    )


def _first(outside: Outside) -> list[tuple[int, float | None]]:
    found = zip(outside.pieces[:5].tolist(), outside.excess_mm.tolist(), strict=False)
    return [(piece, excess if np.isfinite(excess) else None) for piece, excess in found]


def rows_of(name: str, terminals: int, found: Found, peer: Found | None = None) -> list[Any]:
    """The correctness rows of the issue's table for one file."""

    def line(what: str, key: str, unit: str, limit: float, goal: str) -> dict[str, Any]:
        value = getattr(found, key)
        other = {"name": "svv 0.0.57", "value": getattr(peer, key)} if peer else None
        return row(f"{name}: {what}", value, unit, goal, value <= limit, other)

    rows = [
        row(
            f"{name}: terminals",
            found.terminals,
            "1",
            f"{terminals}",
            found.terminals == terminals,
        ),
        line("colliding pairs", "colliding_pairs", "pairs", 0, "0"),
        line("overlaps within joints", "overlaps_percent", "% of segments", 2.0, "<= 2"),
        line("segments out of tissue", "segments_outside", "segments", 0, "0"),
        line("terminal flow spread", "flow_spread", "(max - min) / mean", 1e-9, "< 1e-9"),
        line("Murray residual", "murray_residual", "relative", 1e-9, "< 1e-9"),
        line("radii against consistent ones", "radius_error", "relative", 1e-9, "< 1e-9"),
    ]
    rows.append(_coverage_row(name, found, peer))
    if found.colliding_pairs:
        rows[1] |= {"first_pieces": found.first_colliding, "deepest_mm": found.deepest_collision_mm}
    if found.segments_outside:
        rows[3] |= {"pieces_and_excess_mm": found.first_outside}
    return rows


def _coverage_row(name: str, found: Found, peer: Found | None) -> dict[str, Any]:
    other = {"name": "svv 0.0.57"} | asdict(peer.coverage) if peer else None
    reach = row(
        f"{name}: mean way to the nearest terminal", found.coverage.mean_mm, "mm", peer=other
    )
    near = found.coverage.near_surface
    return reach | {"p95_mm": found.coverage.p95_mm, "density_near_surface": near}
