"""Compute all measures of a network in its tissue: shape, junctions, paths, supply, oxygen."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, is_dataclass
from typing import Any

import numpy as np

from design.errors import DesignError
from design.measures.junctions import (
    MurrayResiduals,
    TerminalFlow,
    measure_murray,
    measure_terminal_flow,
)
from design.measures.morphometry import Morphometry, measure_morphometry
from design.measures.paths import FlowPaths, measure_paths
from design.measures.supply import BEYOND_UM, OxygenModel, Supply, measure_supply, sample_tissue
from design.network import VesselKind, VesselNetwork
from design.tissue import Tissue
from design.vasculature.growth.supply import SupplyBalance, supply_balance
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class MeasureOptions:
    """Options of measuring a network.

    Attributes
    ----------
    samples : int
        Points in the tissue.
    seed : int
        Of the points.
    printable_diameter_mm : float, optional
        Smallest lumen that can be printed: the supply is measured again for those at least as
        wide (straight pieces count, by the thinner end).
    murray_exponent : float
        γ of the residuals.
    oxygen : OxygenModel
    """

    samples: int = 200_000
    seed: int = 1
    printable_diameter_mm: float | None = None
    murray_exponent: float = 3.0
    oxygen: OxygenModel = field(default_factory=OxygenModel)

    def __post_init__(self) -> None:
        if self.samples < 1:
            raise DesignError(f"measures: {self.samples} samples; give at least 1")
        wanted = {"murray_exponent": self.murray_exponent}
        if self.printable_diameter_mm is not None:
            wanted["printable_diameter_mm"] = self.printable_diameter_mm
        for name, value in wanted.items():
            if not (np.isfinite(value) and value > 0.0):
                raise DesignError(f"measures: {name} is {value:g}; give a value above 0")


@dataclass(frozen=True)
class NetworkMeasures:
    """What a network is like and how it serves its tissue.

    Attributes
    ----------
    options : MeasureOptions
    vessels, inlets, outlets : int
    tissue_mm3 : float, mm³
        Volume of the tissue, lumens included.
    length_mm, volume_mm3, surface_mm2 : float
        Of all lumens, each piece a cone between its radii; where vessels join, what they share
        counts for each.
    diameter_least_mm, diameter_greatest_mm : float, mm
    supply : Supply or None
        By all lumens; None when they leave no tissue.
    printable : Supply or None
        By the printable ones; None without ``printable_diameter_mm``, or when none is.
    ways : FlowPaths or None
    morphometry : tuple of Morphometry
        One for each kind of vessel that has no loops.
    murray : MurrayResiduals or None
    terminal_flow : TerminalFlow or None
        None without a flow.
    territories : SupplyBalance or None
        What the terminals supply over what the tissue nearest to each asks for; None without a
        flow, or with fewer than two terminals.
    """

    options: MeasureOptions
    vessels: int
    inlets: int
    outlets: int
    tissue_mm3: float
    length_mm: float
    volume_mm3: float
    surface_mm2: float
    diameter_least_mm: float
    diameter_greatest_mm: float
    supply: Supply | None
    printable: Supply | None
    ways: FlowPaths | None
    morphometry: tuple[Morphometry, ...]
    murray: MurrayResiduals | None
    terminal_flow: TerminalFlow | None
    territories: SupplyBalance | None


def measure_network(
    network: VesselNetwork,
    tissue: Tissue,
    options: MeasureOptions | None = None,
    flow: FloatArray | None = None,
) -> NetworkMeasures:
    """Measure any network in a tissue.

    Parameters
    ----------
    network : VesselNetwork
    tissue : Tissue
    options : MeasureOptions, optional
    flow : (v,) float64, µL/s, optional
        Flow of each vessel, for the terminals' spread (``solve_flow(...).flow``).

    Raises
    ------
    DesignError
        When the tissue can't be sampled, or the flow isn't one value a vessel.
    """
    options = options or MeasureOptions()
    points = sample_tissue(tissue, options.samples, options.seed)
    start, end, ra, rb, _ = network.pieces()
    steps = np.linalg.norm(end - start, axis=1)
    slant = np.hypot(steps, rb - ra)
    return NetworkMeasures(
        options=options,
        vessels=network.vessel_count,
        inlets=len(network.inlets()),
        outlets=len(network.outlets()),
        tissue_mm3=tissue.volume_mm3,
        length_mm=float(steps.sum()),
        volume_mm3=float(np.pi / 3.0 * (steps * (ra * ra + ra * rb + rb * rb)).sum()),
        surface_mm2=float(np.pi * ((ra + rb) * slant).sum()),
        diameter_least_mm=2.0 * float(network.radius.min()),
        diameter_greatest_mm=2.0 * float(network.radius.max()),
        supply=measure_supply((start, end, ra, rb), points, tissue.volume_mm3, options.oxygen),
        printable=_printable(network, tissue, points, options),
        ways=measure_paths(network),
        morphometry=measure_morphometry(network),
        murray=measure_murray(network, options.murray_exponent),
        terminal_flow=None if flow is None else measure_terminal_flow(network, flow),
        territories=(
            None if flow is None else measure_territories(network, tissue, flow, options.seed)
        ),
    )


def _printable(
    network: VesselNetwork, tissue: Tissue, points: FloatArray, options: MeasureOptions
) -> Supply | None:
    if options.printable_diameter_mm is None:
        return None
    start, end, ra, rb, _ = network.pieces()
    # A lumen of just the printable diameter passes, whatever halving and doubling rounded.
    wide = 2.0 * np.minimum(ra, rb) >= options.printable_diameter_mm * (1.0 - 1e-9)
    if not wide.any():
        return None
    kept = (start[wide], end[wide], ra[wide], rb[wide])
    return measure_supply(kept, points, tissue.volume_mm3, options.oxygen)


def measure_territories(
    network: VesselNetwork, tissue: Tissue, flow: FloatArray, seed: int
) -> SupplyBalance | None:
    """Compare each terminal's flow with its territory's demand.

    Terminals are the nodes where arteries end, whatever goes on from there; in a network without
    arteries its outlets. None with fewer than two, or without flow.

    Parameters
    ----------
    flow : (v,) float64, µL/s
        In each vessel.
    """
    arteries = network.kind == VesselKind.ARTERY
    tips = _ends_of(network, arteries) if arteries.any() else network.outlets()
    into = np.bincount(
        network.vessel_nodes[:, 1], np.maximum(flow, 0.0), minlength=len(network.nodes)
    )
    supplied = np.asarray(into[tips], dtype=np.float64)
    if len(tips) < 2 or not supplied.sum() > 0.0:
        return None
    return supply_balance(tissue, network.nodes[tips], supplied, seed)


def _ends_of(network: VesselNetwork, which: np.ndarray) -> IntArray:
    """Nodes that vessels of a kind enter and none of them leave."""
    first, last = network.vessel_nodes[which].T
    return np.setdiff1d(last, first)


def measures_dict(measures: NetworkMeasures) -> dict[str, Any]:
    """Nested dictionaries, lists, numbers and None; keys name their units.

    ``supply`` and ``printable`` hold shares of the tissue beyond each distance under ``beyond``,
    by the distance in µm. ``morphometry`` has a table per kind of vessel, its lists by order from
    1; per-vessel orders are left out.
    """
    table = {
        name: _plain(value)
        for name, value in vars(measures).items()
        if name not in ("supply", "printable", "morphometry")
    }
    table["supply"] = _supply(measures.supply)
    table["printable"] = _supply(measures.printable)
    table["morphometry"] = {
        each.kind.name.lower(): _morphometry(each) for each in measures.morphometry
    }
    return table


def _supply(supply: Supply | None) -> dict[str, Any] | None:
    if supply is None:
        return None
    table: dict[str, Any] = _plain(supply)
    table["beyond"] = {f"{um:g}_um": p for um, p in zip(BEYOND_UM, supply.beyond, strict=True)}
    return table


def _morphometry(each: Morphometry) -> dict[str, Any]:
    return {
        "strahler": _plain(each.strahler),
        "diameter_defined": _plain(each.diameter_defined),
        "diameter_order_change": each.diameter_order_change,
    }


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return _plain(asdict(value))
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value.item() if isinstance(value, np.generic) else value
