"""The network, and what its vessels can be coloured by, for the 3D view."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.network import VesselKind, VesselNetwork
from registration.report.colours import KIND_COLOURS
from registration.report.packing import pack
from registration.report.sections import mapping, records
from registration.report.surface import robust_limits
from registration.report.tables import Record, vessel_index
from registration.report.wording import is_number

_FLOW: Final = (
    ("flow_ml_min", "Flow", "mL/min"),
    ("velocity_mm_s", "Velocity", "mm/s"),
    ("wall_shear_pa", "Wall shear", "Pa"),
    ("pressure_in_mmhg", "Inlet pressure", "mmHg"),
)
_GAUGED: Final = (
    ("error_percent", "Diameter error", "%"),
    ("rms_um", "RMS deviation", "µm"),
    ("offset_um", "Axis offset", "µm"),
)


def network_view(network: VesselNetwork, data: Mapping[str, Any]) -> dict[str, Any]:
    """Polylines and colourings as JSON values; positions to float32 precision."""
    gauged = records(mapping(data, "registration"), "vessels")
    flow = records(mapping(data, "flow"), "vessels")
    names = {**vessel_names(flow), **vessel_names(gauged)}
    return {
        "points": pack(network.points.astype(np.float32).ravel()),
        "radius": pack(network.radius.astype(np.float32)),
        "offset": pack(network.offset.astype(np.int32)),
        "names": [names.get(v, str(v)) for v in range(network.vessel_count)],
        "kinds": [VesselKind(int(k)).name.lower() for k in network.kind],
        "kind_colours": KIND_COLOURS,
        "colourings": colourings(network, gauged, flow),
    }


def vessel_names(rows: Sequence[Record]) -> dict[int, str]:
    """What records call each vessel, where they give it a name."""
    named = ((vessel_index(row), row.get("name")) for row in rows)
    return {index: str(name) for index, name in named if index is not None and name}


def colourings(
    network: VesselNetwork, gauged: Sequence[Record], flow: Sequence[Record]
) -> list[dict[str, Any]]:
    """Quantities known for at least one vessel, each with a value (or None) per vessel."""
    made = [_colouring("Designed diameter", "mm", 2.0 * network.mean_radius())]
    for rows, wanted in ((gauged, _GAUGED), (flow, _FLOW)):
        for key, name, unit in wanted:
            values = per_vessel(rows, key, network.vessel_count)
            if np.isfinite(values).any():
                made.append(_colouring(name, unit, values))
    return made


def per_vessel(rows: Sequence[Record], key: str, count: int) -> NDArray[np.float64]:
    """The records' values by number of vessel, (count,); NaN where there is none."""
    values = np.full(count, np.nan)
    for row in rows:
        index, value = vessel_index(row), row.get(key)
        if index is not None and 0 <= index < count and is_number(value):
            values[index] = float(value)
    return values


def _colouring(name: str, unit: str, values: NDArray[np.float64]) -> dict[str, Any]:
    listed = [float(v) if np.isfinite(v) else None for v in values]
    low, high = robust_limits(values)
    return {"name": name, "unit": unit, "limits": [low, high], "values": listed}


def point_pressure(network: VesselNetwork, flow: Sequence[Record]) -> NDArray[np.float64] | None:
    """Pressure at each point of the polylines from that at the vessels' ends, (p,), mmHg.

    It falls evenly along a vessel of even diameter; a taper's curve is drawn straight.

    Returns
    -------
    (p,) float64 or None
        None when no vessel has both pressures.
    """
    count = network.vessel_count
    first = per_vessel(flow, "pressure_in_mmhg", count)
    last = per_vessel(flow, "pressure_out_mmhg", count)
    if not np.isfinite(first + last).any():
        return None
    steps = np.linalg.norm(np.diff(network.points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    vessel = np.repeat(np.arange(count), np.diff(network.offset))
    begin, end = along[network.offset[:-1]], along[network.offset[1:] - 1]
    part = (along - begin[vessel]) / (end - begin)[vessel]
    return np.asarray(first[vessel] + part * (last - first)[vessel], dtype=np.float64)
