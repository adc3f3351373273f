"""Findings of the checkers in one exported tree, as rows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.checkers import (
    Perfusion,
    consistent_radii,
    murray_ratios,
    near_pairs,
    outlet_flows,
    pieces_outside,
    read_network,
    read_stl,
    spread,
)
from benchmarks.common import Row, all_of, row

CLEARANCE_RATIO = 0.1
DROP_PA = 40 * 133.322
VISCOSITY_PA_S = 4e-3


@dataclass(frozen=True)
class Findings:
    """Measures of one exported network.

    ``overlaps_percent``: pairs within joints, of all segments; ``flow_spread`` of the terminals,
    (max - min) / mean; ``murray_residual``, ``radius_error``: largest relative departure of Σ r³
    from the parent's, and of the file's radii from consistent ones.
    """

    terminals: int
    colliding_pairs: int
    first_colliding: list[list[int]]
    overlaps_percent: float
    segments_outside: int
    first_outside: list[int]
    inflow_ul_s: float
    flow_spread: float
    murray_residual: float
    radius_error: float


def check(path: Path, stl: Path, flow_ul_s: float) -> Findings:
    """Run all checkers on an exported file and its tissue's STL."""
    net = read_network(path)
    near = near_pairs(net, clearance_ratio=CLEARANCE_RATIO)
    outside = pieces_outside(net, read_stl(stl)).pieces
    flows, ratios = outlet_flows(net, DROP_PA, VISCOSITY_PA_S), murray_ratios(net)
    radius = consistent_radii(net, Perfusion(flow_ul_s, DROP_PA, VISCOSITY_PA_S))
    return Findings(
        len(net.outlets()),
        len(near.colliding),
        near.colliding[:5].tolist(),
        100.0 * len(near.within_joints) / net.count,
        len(outside),
        outside[:5].tolist(),
        float(flows.sum()),
        spread(flows),
        float(np.abs(ratios - 1.0).max(initial=0.0)),
        float(np.abs(net.radius / radius[:, None] - 1.0).max()),
    )


def rows_of(
    name: str, terminals: int, found: Findings, peer: Findings | None = None
) -> Iterator[Row]:
    """Yield what a sound tree promises, beside the peer's findings."""
    yield all_of(f"{name}: terminals", found.terminals, terminals)
    for what, key, unit, limit in (
        ("colliding pairs", "colliding_pairs", "pairs", 0.0),
        ("overlaps within joints", "overlaps_percent", "% of segments", 2.0),
        ("segments out of tissue", "segments_outside", "segments", 0.0),
        ("terminal flow spread", "flow_spread", "(max - min) / mean", 1e-9),
        ("Murray residual", "murray_residual", "relative", 1e-9),
        ("radii against consistent ones", "radius_error", "relative", 1e-9),
    ):
        value = getattr(found, key)
        other = {"name": "svv 0.0.57", "value": getattr(peer, key)} if peer else None
        more = {"first": found.first_colliding} if key == "colliding_pairs" and value else {}
        yield row(f"{name}: {what}", value, unit, f"<= {limit:g}", value <= limit, other) | more
