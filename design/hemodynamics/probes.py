"""Place probes on vessel centrelines, for comparing flow and pressure of different solvers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.errors import FlowError
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Probes:
    """Places on vessels' centrelines.

    Attributes
    ----------
    vessel : (p,) int64
    fraction : (p,) float64
        Of the vessel's arc length from its first node, 0 to 1.
    """

    vessel: IntArray
    fraction: FloatArray

    def check(self, network: VesselNetwork) -> None:
        """Raise `FlowError` where a place isn't on the network."""
        if self.vessel.shape != self.fraction.shape:
            raise FlowError(
                f"{len(self.vessel)} vessels and {len(self.fraction)} fractions of probes; give "
                "one each"
            )
        outside = (self.vessel < 0) | (self.vessel >= network.vessel_count)
        if outside.any():
            raise FlowError(
                f"a probe is on vessel {int(self.vessel[outside][0])}, and the network has 0 to "
                f"{network.vessel_count - 1}"
            )
        off = ~((self.fraction >= 0.0) & (self.fraction <= 1.0))
        if off.any():
            raise FlowError(
                f"a probe is at {self.fraction[off][0]:g} of its vessel's length; give 0 to 1"
            )


@dataclass(frozen=True)
class ProbeWaves:
    """Flow and pressure at probes over a cycle.

    Attributes
    ----------
    time_s : (t,) float64
        Within one cycle, its end left out; one time in steady flow.
    pressure : (p, t) float64, Pa
    flow : (p, t) float64, µL/s
        Positive from the vessel's first node to its last.
    """

    time_s: FloatArray
    pressure: FloatArray
    flow: FloatArray


def midpoints(network: VesselNetwork) -> Probes:
    """Return the middle of every vessel."""
    count = network.vessel_count
    return Probes(np.arange(count), np.full(count, 0.5))


def probes_along(vessel: int, count: int) -> Probes:
    """Return so many places along one vessel, evenly apart and away from its ends."""
    return Probes(np.full(count, vessel), (np.arange(count) + 0.5) / count)


def clear_parts(network: VesselNetwork) -> FloatArray:
    """Begin and end of each vessel's part that is clear of the junctions, of its length, (v, 2).

    It lies outside the widest vessels at the vessel's ends, and a radius further. Of a vessel
    that is too short for that, the middle fifth.
    """
    ends = np.stack([network.offset[:-1], network.offset[1:] - 1], axis=1)
    wide = np.zeros(len(network.nodes))
    np.maximum.at(wide, network.vessel_nodes.ravel(), network.radius[ends].ravel())
    wide[network.degree() == 1] = 0.0
    own, length = network.mean_radius()[:, None], network.lengths()[:, None]
    most = 0.4  # of the length at either end: the middle fifth is left
    reach = np.minimum((wide[network.vessel_nodes] + own) / length, most)
    return np.column_stack([reach[:, 0], 1.0 - reach[:, 1]])
