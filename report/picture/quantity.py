"""Vessel quantities with their limits and colours: radius, flow, pressure, order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from design.geometry.polyline import arc_lengths
from design.network import VesselKind, VesselNetwork
from design.units import PA_PER_MMHG
from kernels.arrays import FloatArray
from report.picture.colours import (
    DIVERGING,
    KIND_COLOURS,
    NO_DATA,
    SEQUENTIAL,
    TREE_COLOURS,
)

_ROUNDING: Final = 1e-6
"""Of a value, where pages hold it in single precision."""


def point_pressure(
    network: VesselNetwork, first: FloatArray | None, last: FloatArray | None
) -> FloatArray | None:
    """Pressure at each point of the polylines from that at the vessels' ends, (p,).

    It falls evenly along a vessel of even diameter; a taper's curve is drawn straight.

    Returns
    -------
    (p,) float64 or None
        None when no vessel has both pressures.
    """
    if first is None or last is None or not np.isfinite(first + last).any():
        return None
    along = arc_lengths(network.points)
    vessel = np.repeat(np.arange(network.vessel_count), np.diff(network.offset))
    begin, end = along[network.offset[:-1]], along[network.offset[1:] - 1]
    part = (along - begin[vessel]) / (end - begin)[vessel]
    return np.asarray(first[vessel] + part * (last - first)[vessel], dtype=np.float64)


def bar_ends(
    limits: tuple[float, float], extremes: tuple[float, float] | None
) -> Literal["neither", "min", "max", "both"]:
    """Matplotlib's ``extend`` of a colour bar: at which ends values lie beyond its limits."""
    least, greatest = extremes or limits
    rounding = _ROUNDING * max(map(abs, limits))
    below, above = least < limits[0] - rounding, greatest > limits[1] + rounding
    return ("both" if above else "min") if below else "max" if above else "neither"


def bar_limits(limits: tuple[float, float]) -> tuple[float, float]:
    """Return where a colour bar ends: a constant is at the foot of a bar of any height."""
    low, high = limits
    return (low, high) if high > low else (low, low + (abs(low) or 1.0))


ScaleKind = Literal["linear", "log", "diverging", "names"]
LOG_FROM = 8.0
"""Numbers that span more than this factor are shown on a logarithmic scale."""


@dataclass(frozen=True, eq=False)
class Quantity:
    """A number for each vessel, or for each point of the polylines.

    Attributes
    ----------
    key, name, unit : str
        For the command line, and for the reader.
    values : (v,) or (p,) float64
        NaN where it isn't known, shown grey.
    scale : {"linear", "log", "diverging", "names"}
        With "names" the values are numbers of ``labels`` and ``colours``.
    limits : (float, float)
        Ends of the colour bar; equal ones of a constant.
    labels, colours : tuples of str
        Of the named values.
    """

    key: str
    name: str
    unit: str
    values: FloatArray
    scale: ScaleKind
    limits: tuple[float, float]
    labels: tuple[str, ...] = ()
    colours: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """Name and unit, as axes are labelled."""
        return f"{self.name} / {self.unit}" if self.unit else self.name

    @property
    def extremes(self) -> tuple[float, float]:
        """Least and greatest known value; they may lie beyond `limits`."""
        return float(np.nanmin(self.values)), float(np.nanmax(self.values))

    def at_points(self, network: VesselNetwork) -> bool:
        """Whether there is a value for each point of the polylines, not for each vessel."""
        return len(self.values) != network.vessel_count

    def piece_ends(self, network: VesselNetwork) -> tuple[FloatArray, FloatArray]:
        """The value at both ends of each straight piece, (n,) each."""
        of_point = np.repeat(np.arange(network.vessel_count), np.diff(network.offset))
        first = np.flatnonzero(of_point[:-1] == of_point[1:])
        if not self.at_points(network):
            return self.values[of_point[first]], self.values[of_point[first]]
        return self.values[first], self.values[first + 1]

    def place(self, values: FloatArray) -> FloatArray:
        """Place of each value on the colour bar, 0 to 1; NaN stays NaN."""
        low, high = self.limits
        if self.scale == "diverging":
            reach = max(-low, high)
            low, high = -reach, reach
        if self.scale == "log":
            # Nought has no logarithm and goes to the lower end.
            values = np.log(np.maximum(values, low))
            low, high = np.log(low), np.log(high)
        return np.clip((values - low) / ((high - low) or np.inf), 0.0, 1.0)

    def rgb(self, values: FloatArray) -> FloatArray:
        """Colour of each value, (n, 3), sRGB from 0 to 1."""
        known = np.isfinite(values)
        if self.scale == "names":
            palette = np.array([to_rgb(colour) for colour in self.colours])
            colours = palette[np.where(known, values, 0.0).astype(np.int64)]
        else:
            bar = DIVERGING if self.scale == "diverging" else SEQUENTIAL
            colours = bar(self.place(np.where(known, values, self.limits[0])))[:, :3]
        return np.where(known[:, None], colours, np.array(to_rgb(NO_DATA)))


def magnitude(
    key: str, name: str, unit: str, values: NDArray[np.floating[Any]], *, log: bool = True
) -> Quantity | None:
    """A quantity on a linear or (if it spans much, and ``log``) logarithmic scale.

    None where no value is known. Limits are the extremes, as a trunk or a terminal is what one
    looks for.
    """
    numbers: FloatArray = np.asarray(values, dtype=np.float64)
    known = numbers[np.isfinite(numbers)]
    if len(known) == 0:
        return None
    low, high = float(known.min()), float(known.max())
    if log and low >= 0.0 and high > 0.0:
        # Vessels that carry nothing don't set the lower end.
        least = float(known[known > high * 1e-9].min())
        if high > LOG_FROM * least:
            return Quantity(key, name, unit, numbers, "log", (least, high))
    return Quantity(key, name, unit, numbers, "linear", merged_limits((low, high)))


def signed(key: str, name: str, unit: str, values: NDArray[np.floating[Any]]) -> Quantity | None:
    """A quantity about zero, its bar symmetric and without the last percent; None if unknown."""
    numbers: FloatArray = np.asarray(values, dtype=np.float64)
    known = numbers[np.isfinite(numbers)]
    if len(known) == 0:
        return None
    reach = max(float(np.percentile(np.abs(known), 99.0)), 1e-9)
    return Quantity(key, name, unit, numbers, "diverging", (-reach, reach))


def merged_limits(limits: tuple[float, float]) -> tuple[float, float]:
    """Return the limits, equal where only rounding sets them apart."""
    low, high = limits
    return limits if high - low > _ROUNDING * max(abs(low), abs(high)) else (low, low)


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
VELOCITY: Final = "Velocity at mean radius"
SHEAR: Final = "Wall shear at mean radius"
"""As `FlowSolution.wall_shear` is; where a vessel is narrower its wall has more, by 1 / r³."""
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
        magnitude("shear", SHEAR, "Pa", np.abs(flow.get("wall_shear_pa", none))),
        magnitude("velocity", VELOCITY, "mm/s", np.abs(flow.get("velocity_mm_s", none))),
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
