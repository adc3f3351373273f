"""Quantities measured on a search candidate, by their names in the search file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any, Final

import numpy as np

from design.network import VesselNetwork
from design.vasculature import collisions
from printctl.pipeline.printability import Printability

_SLACK: Final = 1e-9
"""A lumen of just the printable width passes, whatever halving and doubling rounded."""


@dataclass(frozen=True)
class GrownCandidate:
    """One candidate, grown and measured.

    Attributes
    ----------
    network : VesselNetwork
        In the design's size.
    measures : mapping
        Of `measures_dict`: the stage's own, in the design's size.
    flow : mapping
        Of `flow_summary`, in the print's size.
    limits : Printability
    band : mapping or None
        Of `band_summary`, in the print's size; None where the recipe asks for no band.
    """

    network: VesselNetwork
    measures: Mapping[str, Any]
    flow: Mapping[str, float]
    limits: Printability
    band: Mapping[str, Any] | None


@dataclass(frozen=True)
class Quantity:
    """One number of a candidate.

    Attributes
    ----------
    label, unit : str
        For people.
    of : function of GrownCandidate
        The number, or None where it has no meaning.
    grain : float
        Differences below it mean nothing (rounding); 0 where all of them count.
    """

    label: str
    unit: str
    of: Callable[[GrownCandidate], float | None]
    grain: float = 0.0

    @property
    def title(self) -> str:
        """Label and unit."""
        return f"{self.label}, {self.unit}" if self.unit else self.label


def numbers_of(grown: GrownCandidate) -> dict[str, float | None]:
    """Every quantity; None where it has no meaning for this network."""
    values = {name: one.of(grown) for name, one in QUANTITIES.items()}
    return {name: None if v is None or not isfinite(v) else float(v) for name, v in values.items()}


def _at(section: str, *path: str, factor: float = 1.0) -> Callable[[GrownCandidate], float | None]:
    """A number of the measures, None where any of the way to it is missing."""

    def of(grown: GrownCandidate) -> float | None:
        value: Any = grown.measures[section]
        for step in path:
            value = None if value is None else value[step]
        return None if value is None else factor * float(value)

    return of


def _flow(key: str) -> Callable[[GrownCandidate], float | None]:
    return lambda grown: grown.flow[key]


def too_thin_percent(grown: GrownCandidate) -> float:
    """Share of the length that is narrower than what can be printed."""
    return _length_percent(grown, lambda low, high: low < grown.limits.lumen_mm * (1 - _SLACK))


def too_wide_percent(grown: GrownCandidate) -> float:
    """Share of the length that is wider than one filament can be; 0 where there is no limit."""
    widest = grown.limits.widest_mm
    if widest is None:
        return 0.0
    return _length_percent(grown, lambda low, high: high > widest * (1 + _SLACK))


def _length_percent(grown: GrownCandidate, counts: Callable[[Any, Any], Any]) -> float:
    """Percent of all pieces' length of which ``counts(thinner, wider diameter)`` is true."""
    start, end, ra, rb, _ = grown.network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    counted = counts(2 * np.minimum(ra, rb), 2 * np.maximum(ra, rb))
    return float(100 * length[counted].sum() / length.sum())


def thin_walls(grown: GrownCandidate) -> float:
    """Places where the wall between two vessels is thinner than what can be printed."""
    return float(collisions(grown.network, grown.limits.wall_mm).count)


def wall_shear_outside_percent(grown: GrownCandidate) -> float | None:
    """Share of the wall's area with a wall shear outside the band; None without a band."""
    if grown.band is None:
        return None
    return 100.0 * (float(grown.band["area_below"]) + float(grown.band["area_above"]))


QUANTITIES: Final[dict[str, Quantity]] = {
    "flow_spread": Quantity(
        "flow spread of the terminals", "", _at("terminal_flow", "spread"), 1e-6
    ),
    "flow_cv": Quantity("flow variation of the terminals", "", _at("terminal_flow", "cv"), 1e-6),
    "supply_over_demand_p5": Quantity(
        "supply over demand, 5th percentile", "", _at("territories", "p5")
    ),
    "distance_mean_mm": Quantity("mean way to a lumen", "mm", _at("supply", "distance_mean_mm")),
    "distance_p95_mm": Quantity(
        "way to a lumen, 95th percentile", "mm", _at("supply", "distance_p95_mm")
    ),
    "distance_max_mm": Quantity("longest way to a lumen", "mm", _at("supply", "distance_max_mm")),
    "beyond_100_um_percent": Quantity(
        "tissue beyond 100 µm of a lumen", "%", _at("supply", "beyond", "100_um", factor=100.0)
    ),
    "beyond_200_um_percent": Quantity(
        "tissue beyond 200 µm of a lumen", "%", _at("supply", "beyond", "200_um", factor=100.0)
    ),
    "printable_distance_p95_mm": Quantity(
        "way to a printable lumen, 95th percentile", "mm", _at("printable", "distance_p95_mm")
    ),
    "anoxic_percent": Quantity(
        "tissue without oxygen (Krogh)", "%", _at("supply", "oxygen", "anoxic", factor=100.0)
    ),
    "too_thin_percent": Quantity("length too thin to print", "%", too_thin_percent),
    "too_wide_percent": Quantity("length too wide for one filament", "%", too_wide_percent),
    "thin_walls": Quantity("walls too thin to print", "", thin_walls),
    "volume_mm3": Quantity("volume of the lumens", "mm³", _at("volume_mm3")),
    "length_mm": Quantity("length of the vessels", "mm", _at("length_mm")),
    "diameter_least_mm": Quantity("thinnest lumen", "mm", _at("diameter_least_mm")),
    "diameter_greatest_mm": Quantity("widest lumen", "mm", _at("diameter_greatest_mm")),
    "terminals": Quantity("terminals", "", _at("outlets")),
    "pressure_drop_mmhg": Quantity("pressure drop", "mmHg", _flow("pressure_drop_mmhg")),
    "dissipated_uw": Quantity("power lost to viscosity", "µW", _flow("dissipated_uw")),
    "wall_shear_min_pa": Quantity("least wall shear", "Pa", _flow("wall_shear_min_pa")),
    "wall_shear_max_pa": Quantity("greatest wall shear", "Pa", _flow("wall_shear_max_pa")),
    "wall_shear_outside_percent": Quantity(
        "wall with a shear outside the band", "%", wall_shear_outside_percent
    ),
}
"""Name to quantity, in the order of the results' file."""
