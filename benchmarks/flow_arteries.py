"""Arterial tree for the 1D flow benchmark, of human size, wave speed and outlet load."""

from __future__ import annotations

import heapq

import numpy as np

from design.hemodynamics import PulsatileConditions, ThinWall, WindkesselOutlet
from design.hemodynamics.waveforms import shape
from design.network import VesselNetwork

VISCOSITY = 4e-3
DENSITY = 1.06e-3
FLOW_UL_S = 83_000.0
"""5 L/min."""
PRESSURE_PA = 13_300.0
"""100 mmHg, the mean."""
COMPLIANCE_UL_PA = 5.0
"""Of all beds together; 0.67 mL/mmHg, less what the vessels have."""
WALL = ThinWall(4e5, 1.2)
"""Waves run at 5 m/s in the root of 12 mm and at 12 m/s in the thinnest, of 2.3 mm."""


def arteries(vessels: int = 50) -> VesselNetwork:
    """The widest vessel splits in two (0.85 and 0.6 of its radius) until there are so many.

    Lengths are 5 to 15 diameters, so that waves meet at no common times.
    """
    rng = np.random.default_rng(1)
    nodes, ends, radius = [[0.0, 0.0, 0.0], [0.0, 0.0, 60.0]], [(0, 1)], [12.0]
    tips = [(-12.0, 1)]
    while len(ends) + 2 <= vessels + 1:
        wide, node = heapq.heappop(tips)
        for ratio in (0.85, 0.6):
            r = -wide * ratio
            way = rng.normal(size=3)
            length = r * rng.uniform(10.0, 30.0)
            nodes.append((np.array(nodes[node]) + way / np.linalg.norm(way) * length).tolist())
            ends.append((node, len(nodes) - 1))
            radius.append(r)
            heapq.heappush(tips, (-r, len(nodes) - 1))
    if len(ends) > vessels:
        # The last pair's thinner one, so that the count is met.
        nodes.pop()
        ends.pop()
        radius.pop()
    kind = np.zeros(len(ends), dtype=np.int64)
    return VesselNetwork.from_segments(
        np.array(nodes), np.array(ends), np.array(radius), kind, kind
    )


def heart_and_beds(network: VesselNetwork) -> PulsatileConditions:
    """A heart's ejection, and a Windkessel at every terminal, its share by area.

    The proximal resistance is the terminal vessel's own impedance, so that the bed takes what
    is fast without an echo.
    """
    terminals = network.outlets()
    vessel = {int(last): k for k, last in enumerate(network.vessel_nodes[:, 1])}
    radius = network.mean_radius()
    share = np.array([radius[vessel[int(node)]] ** 2.5 for node in terminals])
    share /= share.sum()
    outlets = {}
    for node, part in zip(terminals.tolist(), share, strict=True):
        r = radius[vessel[node]]
        k = WALL.young_pa * WALL.thickness_mm / (0.75 * r)
        impedance = DENSITY * np.sqrt(k / (2.0 * DENSITY)) / (np.pi * r * r)
        whole = PRESSURE_PA / (FLOW_UL_S * part)
        outlets[node] = WindkesselOutlet(impedance, COMPLIANCE_UL_PA * part, whole - impedance)
    inlet = shape("ejection", FLOW_UL_S, 1.0)
    return PulsatileConditions(VISCOSITY, inlet, outlet=outlets, wall=WALL, density=DENSITY)
