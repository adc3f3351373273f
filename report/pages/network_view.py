"""Vessel network as data of the 3D view: polylines, colours; thinnest left out if too many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from design.network import VesselNetwork
from kernels.arrays import IntArray
from registration.json_ready import Record
from report.packing import PackedColumn, pack_points, pack_table
from report.picture import FLOW, GAUGED, Quantity, VesselQuantities, quantities
from report.sections.facts import mapping, records
from report.sections.tables import columns, vessel_index

MAX_PIECES: Final = 60_000
"""Straight pieces that a page shows at most: what an office computer still turns fluently."""
_VESSELS: Final = tuple(PackedColumn(name, "i4", summed=True) for name in ("number", "end"))
"""A vessel's number, and the place after its last point in the page's arrays."""


@dataclass(frozen=True, eq=False)
class ShownVessels:
    """Selection of vessels that a page shows.

    Attributes
    ----------
    vessels : (k,) int64
        Ascending.
    least_diameter_mm : float, mm
        All vessels wider than this are shown; 0 when all are.
    """

    vessels: IntArray
    least_diameter_mm: float


def report_view(network: VesselNetwork, data: Mapping[str, Any]) -> dict[str, object]:
    """`network_view` of what report.json says of each vessel.

    ``strahler_orders`` in `data`: (v,) float64, where they are known already.
    """
    gauged = records(mapping(data, "registration"), "vessels")
    flow = records(mapping(data, "flow"), "vessels")
    names = {**vessel_names(flow), **vessel_names(gauged)}
    known = VesselQuantities(
        flow=columns(flow, FLOW, network.vessel_count),
        gauged=columns(gauged, GAUGED, network.vessel_count),
        orders=data.get("strahler_orders"),
    )
    return network_view(network, quantities(network, known), names)


def network_view(
    network: VesselNetwork,
    colourings: Sequence[Quantity],
    names: Mapping[int, str],
    first: str = "radius",
    most_pieces: int = MAX_PIECES,
) -> dict[str, object]:
    """Polylines and quantities as JSON values.

    Positions are off by less than 1e-5 of the network's extent; numbers are float32.

    Parameters
    ----------
    network : VesselNetwork
    colourings : sequence of Quantity
    names : mapping of vessel to str
        Of vessels that aren't called by their number.
    first : str
        Key of the quantity that is shown first.
    most_pieces : int
        Beyond it the thinnest vessels are left out (see `thin_out`).
    """
    shown = thin_out(network, most_pieces)
    points = _points_of(network, shown.vessels)
    sizes = np.diff(network.offset)[shown.vessels]
    return {
        "points": pack_points(network.points[points], radius=network.radius[points]),
        "vessels": pack_table(_VESSELS, {"number": shown.vessels, "end": np.cumsum(sizes)}),
        # To a tenth of a µm.
        "lengths": np.round(network.lengths()[shown.vessels], 4).tolist(),
        "names": {str(vessel): name for vessel, name in names.items()},
        "first": first,
        "colourings": [_colouring(network, each, shown.vessels, points) for each in colourings],
        "vessel_count": network.vessel_count,
        "shown_count": len(shown.vessels),
        "least_diameter_mm": shown.least_diameter_mm,
    }


def thin_out(network: VesselNetwork, most_pieces: int) -> ShownVessels:
    """Leave out the thinnest vessels until at most ``most_pieces`` straight pieces are left.

    A vessel counts by its widest point; of vessels as wide as the first that doesn't fit none is
    shown, so that what is missing can be told in one number.
    """
    sizes = np.diff(network.offset) - 1
    if sizes.sum() <= most_pieces:
        return ShownVessels(np.arange(network.vessel_count), 0.0)
    width = np.maximum.reduceat(network.radius, network.offset[:-1])
    order = np.argsort(-width, kind="stable")
    fits = int(np.searchsorted(np.cumsum(sizes[order]), most_pieces, side="right"))
    limit = float(width[order[fits]])
    shown = np.flatnonzero(width > limit)
    if len(shown) == 0:
        # All alike: then as many as fit.
        shown = np.sort(order[: max(fits, 1)])
    return ShownVessels(shown, 2.0 * limit)


def _points_of(network: VesselNetwork, vessels: IntArray) -> IntArray:
    """Places of the vessels' points in the network's arrays."""
    kept = np.zeros(network.vessel_count, dtype=bool)
    kept[vessels] = True
    return np.flatnonzero(np.repeat(kept, np.diff(network.offset)))


def _colouring(
    network: VesselNetwork, quantity: Quantity, vessels: IntArray, points: IntArray
) -> dict[str, object]:
    at_points = quantity.at_points(network)
    values = quantity.values[points if at_points else vessels]
    return {
        "key": quantity.key,
        "name": quantity.name,
        "unit": quantity.unit,
        "scale": quantity.scale,
        "limits": list(quantity.limits),
        "extremes": list(quantity.extremes),
        "labels": list(quantity.labels),
        "colours": list(quantity.colours),
        "at": "point" if at_points else "vessel",
        "values": pack_table([PackedColumn("value", "f4")], {"value": values}),
    }


def vessel_names(rows: Sequence[Record]) -> dict[int, str]:
    """What records call each vessel, where they give it a name."""
    named = ((vessel_index(row), row.get("name")) for row in rows)
    return {index: str(name) for index, name in named if index is not None and name}
