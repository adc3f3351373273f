"""Values of a vessel quantity with their limits and colour scale, mapped to colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.report.picture.colours import DIVERGING, NO_DATA, SEQUENTIAL

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
        Ends of the colour bar.
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
        return np.clip((values - low) / (high - low), 0.0, 1.0)

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
    return Quantity(key, name, unit, numbers, "linear", separate_limits((low, high)))


def signed(key: str, name: str, unit: str, values: NDArray[np.floating[Any]]) -> Quantity | None:
    """A quantity about zero, its bar symmetric and without the last percent; None if unknown."""
    numbers: FloatArray = np.asarray(values, dtype=np.float64)
    known = numbers[np.isfinite(numbers)]
    if len(known) == 0:
        return None
    reach = max(float(np.percentile(np.abs(known), 99.0)), 1e-9)
    return Quantity(key, name, unit, numbers, "diverging", (-reach, reach))


def separate_limits(limits: tuple[float, float]) -> tuple[float, float]:
    """Limits that are apart, as a colour bar needs them."""
    low, high = limits
    if high - low > 1e-9 * max(abs(low), abs(high)):
        return limits
    half = 0.5 * abs(low) or 0.5
    return (low - half, low + half)
