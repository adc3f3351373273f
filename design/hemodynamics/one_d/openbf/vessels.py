"""Read the vessels of openBF's input: lengths, radii, walls, profiles and outlets."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from design.errors import FlowError
from design.hemodynamics.json_keys import flag, text, whole
from design.hemodynamics.one_d.openbf.keys import quantity
from design.hemodynamics.one_d.openbf.outlets import VesselEnd, outlet_of, refuse_inner
from design.hemodynamics.vessel.wall import VesselWalls
from design.hemodynamics.zero_d.pulsatile.conditions import Outlet
from design.network import VesselKind, VesselNetwork
from kernels.arrays import FloatArray, IntArray

_LENGTH: Final = (1e-6, 1e3)
_RADIUS: Final = (1e-7, 1.0)
_MM: Final = 1e3
_PRESSURE: Final = (-1e9, 1e9)


@dataclass(frozen=True)
class Vessels:
    """Vessels of a file, in our units.

    Attributes
    ----------
    labels : (v,) tuple of str
    network : VesselNetwork
    walls : VesselWalls
    exponents : (v,) float64
        ζ of the velocity profile, ``gamma_profile``.
    cells : (v,) int64
        Of openBF's mesh.
    outlets : dict of node to Outlet
    reflection : dict of node to float
    shown : tuple of int
        Those with ``to_save``.
    """

    labels: tuple[str, ...]
    network: VesselNetwork
    walls: VesselWalls
    exponents: FloatArray
    cells: IntArray
    outlets: dict[int, Outlet]
    reflection: dict[int, float]
    shown: tuple[int, ...]


def read_vessels(listed: Sequence[Mapping[str, Any]], density: float) -> Vessels:
    """Return the vessels of the list ``network``.

    Parameters
    ----------
    listed : sequence of mappings
    density : float, Pa·s²/mm²

    Raises
    ------
    FlowError
        For what is missing, wrong, not modelled, or an inlet that isn't exactly one vessel.
    """
    labels = _labels(listed)
    places = [f"vessel {label}" for label in labels]
    both = list(zip(listed, places, strict=True))
    for data, place in both:
        _refuse_unmodelled(data, place)
    nodes, ends = _nodes(both)
    lengths = np.array([quantity(d, "L", p, _LENGTH) for d, p in both])
    radii = np.array([_radii(d, p) for d, p in both]) * _MM
    walls = VesselWalls(
        young_pa=np.array([quantity(d, "E", p, (1e-3, 1e15)) for d, p in both]),
        thickness_mm=np.array([_thickness(d, p) for d, p in both]) * _MM,
        external_pa=np.array([quantity(d, "Pext", p, _PRESSURE, 0.0) for d, p in both]),
        viscous=np.array([flag(d, "visco-elastic", p, default=False) for d, p in both]),
    )
    vessels = Vessels(
        labels=labels,
        network=_network(nodes, lengths * _MM, radii),
        walls=walls,
        exponents=np.array([quantity(d, "gamma_profile", p, (2.0, 100.0), 2.0) for d, p in both]),
        cells=np.array([_cells(d, p, x) for (d, p), x in zip(both, lengths.tolist(), strict=True)]),
        outlets={},
        reflection={},
        shown=tuple(k for k, (d, p) in enumerate(both) if flag(d, "to_save", p, default=True)),
    )
    _read_outlets(vessels, both, ends, density)
    return vessels


def _labels(listed: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    labels = tuple(text(v, "label", f"network[{k}]") for k, v in enumerate(listed))
    for label in labels:
        if labels.count(label) > 1:
            raise FlowError(f"network: the label {label!r} stands twice; give each its own")
    return labels


def _refuse_unmodelled(data: Mapping[str, Any], place: str) -> None:
    for key in ("initial_pressure", "initial_flow"):
        if quantity(data, key, place, (-math.inf, math.inf), 0.0) != 0.0:
            raise FlowError(
                f"{place}: {key} isn't 0; the periodic state, which is what is solved for, "
                "doesn't depend on it: leave it out"
            )


def _nodes(both: Sequence[tuple[Mapping[str, Any], str]]) -> tuple[IntArray, list[bool]]:
    """First and last node of each vessel from 0, and whether it ends in an outlet.

    Every outlet has a node of its own: where openBF's vessels end in one, they don't meet.
    """
    named = [(whole(d, "sn", p, 1), whole(d, "tn", p, 1)) for d, p in both]
    starts, stops = {sn for sn, _ in named}, {tn for _, tn in named}
    inlets = [p for (_, p), (sn, _) in zip(both, named, strict=True) if sn not in stops]
    if len(inlets) != 1:
        what = f"{', '.join(inlets[:3])} begin" if inlets else "none begins"
        raise FlowError(f"sn: one vessel begins where none ends, the inlet; here {what} there")
    number = {node: k for k, node in enumerate(sorted(starts))}
    ends, is_outlet = [], []
    for (_, place), (sn, tn) in zip(both, named, strict=True):
        if sn == tn:
            raise FlowError(f"{place}: sn and tn are both {sn}; a vessel joins two nodes")
        ends.append(tn not in starts)
        last = len(starts) + sum(ends) - 1 if ends[-1] else number[tn]
        is_outlet.append((number[sn], last))
    return np.array(is_outlet), ends


def _radii(data: Mapping[str, Any], place: str) -> tuple[float, float]:
    """Radius at the first and last node, m."""
    if "Rp" in data and "R0" in data:
        raise FlowError(f"{place}: R0 is given, and Rp; leave one of them out")
    if "Rp" not in data and "R0" not in data:
        raise FlowError(f"{place}: R0 is missing, and Rp; give one of them, in m")
    first = quantity(data, "Rp" if "Rp" in data else "R0", place, _RADIUS)
    return first, quantity(data, "Rd", place, _RADIUS, first)


def _thickness(data: Mapping[str, Any], place: str) -> float:
    return quantity(data, "h0", place, (1e-9, 1.0)) if "h0" in data else math.nan


def _cells(data: Mapping[str, Any], place: str, length_m: float) -> int:
    """Cells of openBF's mesh: as asked, five at least, none longer than 1 mm."""
    return max(5, whole(data, "M", place, 1, 5), math.ceil(length_m * 1e3))


def _network(nodes: IntArray, lengths: FloatArray, radii: FloatArray) -> VesselNetwork:
    """Vessels that go out from one point and back, the taper in a straight line, mm."""
    count = len(nodes)
    points = np.zeros((count, 3, 3))
    points[:, 1, 0] = lengths / 2.0
    return VesselNetwork(
        nodes=np.zeros((int(nodes.max()) + 1, 3)),
        vessel_nodes=nodes,
        kind=np.full(count, int(VesselKind.ARTERY)),
        tree=np.zeros(count, dtype=np.int64),
        offset=3 * np.arange(count + 1),
        points=points.reshape(-1, 3),
        radius=np.column_stack([radii[:, 0], radii.mean(axis=1), radii[:, 1]]).ravel(),
    )


def _read_outlets(
    vessels: Vessels,
    both: Sequence[tuple[Mapping[str, Any], str]],
    ends: Sequence[bool],
    density: float,
) -> None:
    radius = vessels.network.radius[2::3]
    stiff = vessels.walls.stiffness(np.arange(len(ends)), radius)
    impedance = np.sqrt(density * stiff / 2.0) / (np.pi * radius**2) * 1e9
    for k, (data, place) in enumerate(both):
        if not ends[k]:
            refuse_inner(data, place)
            continue
        end = VesselEnd(place, float(impedance[k]), float(vessels.walls.external_pa[k]))
        node = int(vessels.network.vessel_nodes[k, 1])
        vessels.outlets[node], part = outlet_of(data, end)
        if part is not None:
            vessels.reflection[node] = part
