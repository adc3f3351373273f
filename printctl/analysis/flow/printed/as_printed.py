"""Build a network from designed axes and the lumen sections measured on a registered print."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.errors import FlowError
from design.geometry.polyline import arc_lengths, places_along
from design.hemodynamics import FlowConditions, PulsatileConditions, Supply, solve_flow
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray
from printctl.errors import UsageError
from printctl.run_folder.artefacts import NUMBERS
from registration.measuring.gauging import (
    MeasuredLumen,
    connected_vessels,
    drop_dead_ends,
    network_of_lumens,
    sub_network,
)
from registration.measuring.gauging.trace import stations

_FEW: Final = 0.5
"""Of a vessel without a section: spacing of its stations over its length."""


@dataclass(frozen=True)
class PrintedNetwork:
    """A network's lumens as they were measured, vessels numbered as designed.

    Attributes
    ----------
    network : VesselNetwork
        With the measured radii.
    closed : (v,) bool
        Registration found the vessel closed.
    measured : (v,) bool
        Whether any of its diameters was measured; where none was, it is taken as far off the
        design as the others' median.
    """

    network: VesselNetwork
    closed: np.ndarray[Any, np.dtype[np.bool_]]
    measured: np.ndarray[Any, np.dtype[np.bool_]]


def read_print(folder: Path) -> tuple[list[dict[str, Any]], FloatArray]:
    """Read what registration says of each vessel, and the print's size over the design's.

    Returns
    -------
    rows : list of dict
    scale : (3,) float64
        Along x, y, z; 1 where the registration has none.

    Raises
    ------
    UsageError
        When the run has no registration, or one that can't be read.
    """
    path = folder / NUMBERS
    if not path.is_file():
        raise UsageError(
            f"--as-printed takes lumens from {NUMBERS} of a run whose print was registered, and "
            f"there is none at {path}; register a scan first, or leave --as-printed out"
        )
    try:
        numbers = json.loads(path.read_text(encoding="utf-8"))
        scale = np.array(numbers.get("scale", (1.0, 1.0, 1.0)), dtype=np.float64).reshape(3)
        return list(numbers["vessels"]), scale
    except (ValueError, KeyError, TypeError, AttributeError) as exc:
        raise UsageError(f"{path} can't be read ({exc}); register the scan again") from exc


def printed_lumens(network: VesselNetwork, rows: Sequence[Mapping[str, Any]]) -> PrintedNetwork:
    """Put measured sections on the designed axes, as registration's own 0D flow does.

    Parameters
    ----------
    network : VesselNetwork
        The design.
    rows : sequence of mapping
        Of `registration.json`, one a vessel.

    Raises
    ------
    UsageError
        When the rows aren't of this network, or no diameter was measured at all.
    """
    if [row.get("vessel") for row in rows] != list(range(network.vessel_count)):
        raise UsageError(f"{NUMBERS} isn't of this network.csv; register the scan again")
    lumens = [_lumen(network, vessel, row) for vessel, row in enumerate(rows)]
    measured = np.array([bool(np.isfinite(lumen.diameter).any()) for lumen in lumens])
    if not any(np.isfinite(lumen.error) for lumen in lumens):
        raise UsageError(f"no vessel's diameter was measured in {NUMBERS}; leave --as-printed out")
    closed = np.array([row.get("open") is False for row in rows])
    return PrintedNetwork(network_of_lumens(network, lumens), closed, measured)


def _lumen(network: VesselNetwork, vessel: int, row: Mapping[str, Any]) -> MeasuredLumen:
    """A vessel's stations as registration placed them, and what it found at some of them."""
    length = float(network.lengths()[vessel])
    share, places = float(row.get("gauged_fraction") or 0.0), _numbers(row, "along_mm")
    count = round(len(places) / share) if share > 0.0 else 1
    spacing = length / (count - 0.5) if count > 1 else _FEW * length
    along, centre, _, radius = stations(network, vessel, spacing)
    diameter, oval = np.full(len(along), np.nan), np.full(len(along), np.nan)
    place = np.abs(along[:, None] - places).argmin(axis=0) if len(places) else np.zeros(0, np.int64)
    diameter[place] = 1e-3 * _numbers(row, "diameter_um")
    oval[place] = _numbers(row, "ovality_along")
    return MeasuredLumen(centre, radius, diameter, oval)


def _numbers(row: Mapping[str, Any], name: str) -> FloatArray:
    return np.array([np.nan if x is None else x for x in row.get(name, ())], dtype=np.float64)


@dataclass(frozen=True)
class OpenPart:
    """The open vessels between inlets and outlets, as a network of its own.

    Attributes
    ----------
    network : VesselNetwork
        Vessels run the way that the flow does, so that its ends are the design's.
    vessel : (p,) int64
        Number of each in the design.
    sign : (p,) float64
        -1 where a vessel was turned round.
    node : mapping
        Of the design's nodes to its own.
    """

    network: VesselNetwork
    vessel: IntArray
    sign: FloatArray
    node: Mapping[int, int]

    def steady(self, conditions: FlowConditions) -> FlowConditions:
        """The design's conditions with this part's numbers."""
        number = {int(v): k for k, v in enumerate(self.vessel)}
        return replace(
            conditions,
            behind=self._of_nodes(conditions.behind),
            outlet_flow_ul_s=self._of_nodes(conditions.outlet_flow_ul_s),
            supplies=self._supplies(conditions.supplies),
            losses=conditions.losses.in_part(number),
        )

    def pulsatile(self, conditions: PulsatileConditions) -> PulsatileConditions:
        """The design's conditions with this part's numbers."""
        outlet = conditions.outlet
        return replace(
            conditions,
            outlet=self._of_nodes(outlet) if isinstance(outlet, Mapping) else outlet,
            supplies=self._supplies(conditions.supplies),
        )

    def _supplies(self, supplies: Sequence[Supply]) -> tuple[Supply, ...]:
        """Those that still feed an inlet, their whole flow through the inlets left."""
        fed = (
            (tuple(self.node[node] for node in supply.inlets if node in self.node), supply)
            for supply in supplies
        )
        return tuple(replace(supply, inlets=inlets) for inlets, supply in fed if inlets)

    def _of_nodes(self, values: Mapping[int, Any]) -> dict[int, Any]:
        return {self.node[node]: value for node, value in values.items() if node in self.node}


def open_part(printed: PrintedNetwork, design: VesselNetwork) -> OpenPart:
    """What of a printed network flow can run through.

    Closed vessels are taken out, and dead ends behind them.

    Raises
    ------
    FlowError
        When no way is open from an inlet to an outlet.
    """
    inlets, outlets = design.inlets(), design.outlets()
    kept = connected_vessels(
        printed.network, ~printed.closed, tuple(inlets.tolist()), tuple(outlets.tolist())
    )
    kept = drop_dead_ends(printed.network, kept, np.concatenate([inlets, outlets]))
    if not kept.any():
        gone = ", ".join(map(str, np.flatnonzero(printed.closed)[:8]))
        raise FlowError(
            f"the printed vessels that are closed ({gone}) leave no way open from an inlet to an "
            "outlet, so nothing flows; there is nothing to solve"
        )
    vessel = np.flatnonzero(kept)
    part, node = sub_network(printed.network, vessel)
    ends = [node[int(n)] for n in np.concatenate([inlets, outlets]) if int(n) in node]
    sign = _way(part, [node[int(n)] for n in inlets if int(n) in node],
                [node[int(n)] for n in outlets if int(n) in node], ends)  # fmt: skip
    return OpenPart(_turned(part, sign < 0.0), vessel, sign, node)


def _way(part: VesselNetwork, inlets: list[int], outlets: list[int], ends: list[int]) -> FloatArray:
    """-1 for each vessel that flow runs through the other way; those at the ends stay."""
    driven = FlowConditions(1e-3, inlet_flow_ul_s=1.0, inlets=tuple(inlets), outlets=tuple(outlets))
    backwards = solve_flow(part, driven).flow < 0.0
    backwards &= ~np.isin(part.vessel_nodes, ends).any(axis=1)
    return np.where(backwards, -1.0, 1.0)


def _turned(network: VesselNetwork, which: np.ndarray[Any, np.dtype[np.bool_]]) -> VesselNetwork:
    """The network with some of its vessels named the other way round."""
    order = np.arange(len(network.radius))
    for vessel in np.flatnonzero(which):
        mine = slice(network.offset[vessel], network.offset[vessel + 1])
        order[mine] = order[mine][::-1]
    nodes = np.where(which[:, None], network.vessel_nodes[:, ::-1], network.vessel_nodes)
    return replace(
        network, vessel_nodes=nodes, points=network.points[order], radius=network.radius[order]
    )


def even_radii(network: VesselNetwork) -> VesselNetwork:
    """The same with a point every two radii, whose radii conduct as those around it did.

    Sections lie closer than a lumen is wide, and their noise would be steps of its wall in 3D.
    The radius at a point is (mean of r⁻⁴)^-¼ over half an interval to each side.
    """
    points, radii, offset = [], [], [0]
    for vessel in range(network.vessel_count):
        way, radius = network.polyline(vessel)
        path = arc_lengths(way)
        count = max(1, int(path[-1] / (2.0 * radius.mean())))
        fine = np.linspace(0.0, path[-1], 40 * count + 1)
        law = np.interp(fine, path, radius) ** -4.0
        at = np.linspace(0.0, path[-1], count + 1)
        near = np.abs(fine[None] - at[:, None]) <= 0.5 * path[-1] / count + 1e-12
        radii.append(((near * law).sum(axis=1) / near.sum(axis=1)) ** -0.25)
        points.append(places_along(way, path, at))
        offset.append(offset[-1] + count + 1)
    return replace(
        network,
        offset=np.array(offset),
        points=np.concatenate(points),
        radius=np.concatenate(radii),
    )
