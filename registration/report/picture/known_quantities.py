"""Collect the quantities to colour vessels by: radius, flow, pressure, shear, order, deviation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from design.network import VesselKind, VesselNetwork
from design.units import PA_PER_MMHG
from kernels.arrays import FloatArray
from registration.report.picture.colours import KIND_COLOURS, SEQUENTIAL, TREE_COLOURS
from registration.report.picture.pressures import point_pressure
from registration.report.picture.quantity import Quantity, magnitude, signed

Colour = Literal["radius", "flow", "pressure", "shear", "order", "tree", "deviation"]
"""Keys of the quantities that a picture can be coloured by from the command line."""

FLOW: Final = (
    "flow_ml_min",
    "pressure_in_mmhg",
    "pressure_out_mmhg",
    "wall_shear_pa",
    "velocity_mm_s",
)
"""Columns of `Known.flow`."""

GAUGED: Final = ("error_percent", "rms_um", "offset_um")
"""Columns of `Known.gauged`."""

_MMHG_FROM = 1.0
"""Networks with less pressure than this, mmHg, are shown in Pa."""


@dataclass(frozen=True)
class VesselQuantities:
    """What is known of each vessel beside its shape.

    Columns named as in `flow.csv` and `registration.json`, (v,) each, NaN where there is nothing.

    Attributes
    ----------
    flow : mapping
        Of `FLOW`.
    gauged : mapping
        Of `GAUGED`.
    orders : (v,) float64 or None
        Strahler's (`network_strahler_orders`); None to find them.
    """

    flow: Mapping[str, FloatArray] = field(default_factory=dict)
    gauged: Mapping[str, FloatArray] = field(default_factory=dict)
    orders: FloatArray | None = None


def quantities(network: VesselNetwork, known: VesselQuantities | None = None) -> list[Quantity]:
    """All that is known for at least one vessel, the radius first."""
    known = known or VesselQuantities()
    none = np.full(network.vessel_count, np.nan)
    flow, gauged = known.flow, known.gauged
    candidates = [
        magnitude("radius", "Radius", "mm", network.radius),
        magnitude("flow", "Flow", "mL/min", np.abs(flow.get("flow_ml_min", none))),
        pressure(network, flow),
        magnitude("shear", "Wall shear", "Pa", np.abs(flow.get("wall_shear_pa", none))),
        magnitude("velocity", "Velocity", "mm/s", np.abs(flow.get("velocity_mm_s", none))),
        order(network, known.orders),
        named_kinds(network),
        named_trees(network),
        signed("deviation", "Diameter deviation", "%", gauged.get("error_percent", none)),
        magnitude("rms", "RMS deviation", "µm", gauged.get("rms_um", none), log=False),
        magnitude("offset", "Axis offset", "µm", gauged.get("offset_um", none), log=False),
    ]
    return [quantity for quantity in candidates if quantity is not None]


def pressure(network: VesselNetwork, flow: Mapping[str, FloatArray]) -> Quantity | None:
    """Pressure along the vessels, in mmHg, or in Pa where it is low."""
    values = point_pressure(network, flow.get("pressure_in_mmhg"), flow.get("pressure_out_mmhg"))
    if values is None:
        return None
    if np.nanmax(np.abs(values)) < _MMHG_FROM:
        return magnitude("pressure", "Pressure", "Pa", values * PA_PER_MMHG, log=False)
    return magnitude("pressure", "Pressure", "mmHg", values, log=False)


def order(network: VesselNetwork, orders: FloatArray | None = None) -> Quantity | None:
    """Strahler's order, 1 for terminals; NaN for kinds with loops, None where all have them."""
    if orders is None:
        # Kernels, which a page that was given its orders doesn't load.
        from design.measures.morphometry import network_strahler_orders

        orders = network_strahler_orders(network)
    values = orders - 1
    if not np.isfinite(values).any():
        return None
    count = int(np.nanmax(values)) + 1
    labels = tuple(str(n + 1) for n in range(count))
    return _named("order", "Strahler order", values, labels, _steps(count))


def _steps(count: int) -> tuple[str, ...]:
    """Colours of ``count`` orders, even in lightness."""
    shares = np.linspace(0.0, 1.0, max(count, 2))[:count]
    return tuple("#{:02x}{:02x}{:02x}".format(*rgb[:3]) for rgb in SEQUENTIAL(shares, bytes=True))


def named_kinds(network: VesselNetwork) -> Quantity:
    """Artery, vein and so on; kinds that don't occur have no place."""
    occurring, values = np.unique(network.kind, return_inverse=True)
    names = tuple(VesselKind(int(kind)).name.lower() for kind in occurring)
    colours = tuple(KIND_COLOURS[name] for name in names)
    return _named("kind", "Kind of vessel", values, names, colours)


def named_trees(network: VesselNetwork) -> Quantity:
    """Number of the tree; colours come again after the eighth."""
    occurring, values = np.unique(network.tree, return_inverse=True)
    names = tuple(f"tree {number}" for number in occurring.tolist())
    colours = tuple(TREE_COLOURS[i % len(TREE_COLOURS)] for i in range(len(names)))
    return _named("tree", "Tree", values, names, colours)


def _named(
    key: str, name: str, values: NDArray[Any], labels: tuple[str, ...], colours: tuple[str, ...]
) -> Quantity:
    last = float(max(len(labels) - 1, 1))
    numbers = np.asarray(values, dtype=np.float64).reshape(-1)
    return Quantity(key, name, "", numbers, "names", (0.0, last), labels, colours)
