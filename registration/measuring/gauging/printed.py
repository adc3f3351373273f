"""Build a vessel network with the radii measured in a print, for its flow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.measuring.gauging.sections import oval_conductance
from registration.measuring.gauging.trace import VesselTrace


@dataclass(frozen=True)
class MeasuredLumen:
    """A vessel's lumen at its stations.

    Attributes
    ----------
    centre : (n, 3) float64, mm
        On the designed axis.
    designed : (n,) float64, mm
        Radius.
    diameter : (n,) float64, mm
        NaN where it wasn't measured, 0 where the lumen is closed.
    ovality : (n,) float64
        Long over short axis; NaN where unknown.
    """

    centre: FloatArray
    designed: FloatArray
    diameter: FloatArray
    ovality: FloatArray

    @property
    def error(self) -> float:
        """Median of measured less designed radius over the open stations, mm; NaN without any."""
        errors = (self.diameter / 2 - self.designed)[self.diameter > 0]
        return float(np.median(errors)) if len(errors) else float("nan")

    def radius(self, error: float) -> FloatArray:
        """As it conducts, (n,), mm; where nothing was measured, the designed one plus ``error``."""
        thinner = oval_conductance(self.ovality) ** 0.25
        filled = np.maximum(self.designed + error, 0.2 * self.designed)
        with np.errstate(invalid="ignore"):
            return np.where(self.diameter > 0, self.diameter / 2 * thinner, filled)


def printed_network(network: VesselNetwork, traces: tuple[VesselTrace, ...]) -> VesselNetwork:
    """The network with the radii that were measured (`network_of_lumens`)."""
    return network_of_lumens(network, [_lumen(trace) for trace in traces])


def _lumen(trace: VesselTrace) -> MeasuredLumen:
    return MeasuredLumen(trace.centre, trace.radius, trace.diameter, trace.sections.ovality)


def with_printed_lengths(network: VesselNetwork, scale: FloatArray) -> VesselNetwork:
    """The network with its axes stretched to the print's size, radii as they are.

    Parameters
    ----------
    network : VesselNetwork
        On the designed axes.
    scale : (3,) float64
        Size of the print over that of the design along x, y, z.
    """
    return replace(network, nodes=network.nodes * scale, points=network.points * scale)


def network_of_lumens(network: VesselNetwork, lumens: Sequence[MeasuredLumen]) -> VesselNetwork:
    """The network with the radii that were measured, a point at each station.

    Where a station wasn't measured (within a junction, unseen) the radius is the designed one
    plus the vessel's mean error, or where it has none, that of all vessels. An oval lumen of equal
    area conducts less: its radius is smaller by the fourth root of `oval_conductance`. A closed
    section has no radius; take closed vessels out (`perfusion` does).
    """
    errors = [lumen.error for lumen in lumens]
    common = np.array([error for error in errors if np.isfinite(error)])
    fallback = float(np.median(common)) if len(common) else 0.0
    points, radii, offset = [], [], [0]
    for vessel, (lumen, error) in enumerate(zip(lumens, errors, strict=True)):
        way, _ = network.polyline(vessel)
        radius = lumen.radius(error if np.isfinite(error) else fallback)
        points += [way[:1], lumen.centre, way[-1:]]
        radii += [radius[:1], radius, radius[-1:]]
        offset.append(offset[-1] + len(radius) + 2)
    return VesselNetwork(
        nodes=network.nodes,
        vessel_nodes=network.vessel_nodes,
        kind=network.kind,
        tree=network.tree,
        offset=np.array(offset),
        points=np.concatenate(points),
        radius=np.concatenate(radii),
    )
