"""Report steady 0D flow: summary, table of vessels, validity of Poiseuille's law, shear band."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.files import write_text
from design.hemodynamics.conditions import FlowConditions
from design.hemodynamics.vessel_coefficients import POWERS, integrals
from design.hemodynamics.zero_d.boundary import boundary_nodes
from design.hemodynamics.zero_d.steady import FlowSolution, node_inflow
from design.network import VesselNetwork
from design.units import DYN_CM2_PER_PA, PA_PER_MMHG, UL_S_PER_ML_MIN, WATER_DENSITY
from kernels.arrays import FloatArray, IntArray

UW_PER_PA_UL_S = 1e-3


def flow_summary(
    network: VesselNetwork,
    solution: FlowSolution,
    conditions: FlowConditions | None = None,
    density: float | None = None,
) -> dict[str, float]:
    """Totals, extremes and balances for `report.json`; keys name their units.

    ``mass_imbalance`` is the greatest net flow at an inner node over the flow through it.
    ``energy_imbalance`` holds the power that enters and leaves, Σ p Q over inlets and outlets,
    against what viscosity and losses take, Σ R Q² + Σ Δp Q, relative to the latter.
    ``pressure_drop`` is between the network's extremes, and ``resistance`` that drop over the
    inflow (0 where nothing flows).
    ``losses_share``, where losses are modelled, is what junctions and stenoses take of power.
    ``poiseuille_holds_share`` counts vessels in which the flow is laminar and developed but for a
    tenth of the length; ``entrance_share_max`` is the greatest such share.

    Parameters
    ----------
    conditions : FlowConditions, optional
        Those solved for, where they name inlets or outlets other than the network's own.
    density : float, Pa·s²/mm², optional
        Of the Reynolds numbers; the conditions' by default.
    """
    if density is None:
        density = WATER_DENSITY if conditions is None else conditions.density
    ends = (
        np.concatenate([network.inlets(), network.outlets()])
        if conditions is None
        else np.concatenate(boundary_nodes(network, conditions))
    )
    inflow = node_inflow(network, solution.flow)
    entering = float(np.maximum(inflow[ends], 0.0).sum())
    drop = float(np.ptp(solution.pressure))
    number = reynolds(network, solution, density)
    shear = np.abs(solution.wall_shear)
    dissipated = float(solution.resistance @ solution.flow**2)
    lost = 0.0 if solution.loss is None else float(solution.loss @ solution.flow)
    dissipated += lost
    power = float(solution.pressure[ends] @ inflow[ends])
    size = np.abs(solution.flow)
    first, last = (np.bincount(end, size, len(inflow)) for end in network.vessel_nodes.T)
    through = np.asarray(first + last, dtype=np.float64)
    losses = {} if solution.loss is None else {"losses_share": lost / max(dissipated, 1e-300)}
    return losses | {
        "vessel_count": float(network.vessel_count),
        "inflow_ul_s": entering,
        "inflow_ml_min": entering / UL_S_PER_ML_MIN,
        "pressure_drop_pa": drop,
        "pressure_drop_mmhg": drop / PA_PER_MMHG,
        "resistance_pa_s_ul": drop / entering if entering > 0.0 else 0.0,
        "wall_shear_min_pa": float(shear.min()),
        "wall_shear_median_pa": float(np.median(shear)),
        "wall_shear_max_pa": float(shear.max()),
        "velocity_max_mm_s": float(np.abs(solution.velocity).max()),
        "reynolds_max": float(number.max()),
        "entrance_share_max": float(entrance_share(network, number).max()),
        "poiseuille_holds_share": float(poiseuille_holds(network, number).mean()),
        "dissipated_uw": dissipated * UW_PER_PA_UL_S,
        "mass_imbalance": largest_imbalance(np.abs(inflow), through, ends),
        "energy_imbalance": abs(power - dissipated) / dissipated if dissipated > 0.0 else 0.0,
    }


def largest_imbalance(net: FloatArray, through: FloatArray, ends: IntArray) -> float:
    """Return the greatest net flow at an inner node over the flow through it; both (m,)."""
    inner = through > 0.0
    inner[ends] = False
    return float(np.max(net[inner] / through[inner], initial=0.0))


def vessel_columns(network: VesselNetwork) -> dict[str, NDArray[np.generic]]:
    """First columns of a per-vessel table: number, kind, tree, length and diameter, each (v,)."""
    return {
        "vessel": np.arange(network.vessel_count),
        "kind": network.kind_names(),
        "tree": network.tree,
        "length_mm": network.lengths(),
        "diameter_mm": 2.0 * network.mean_radius(),
    }


def flow_table(
    network: VesselNetwork,
    solution: FlowSolution,
    density: float = WATER_DENSITY,
    band: ShearBand | None = None,
) -> dict[str, NDArray[np.generic]]:
    """Columns of a per-vessel table, each (v,).

    Flow, velocity and wall shear are signed: positive along the vessel, from "in" to "out", as
    designed. ``density`` in Pa·s²/mm² goes into the Reynolds number. With a ``band``
    ``wall_shear_band`` says whether the wall shear is below, inside or above it.
    """
    first, last = network.vessel_nodes.T
    pressure_in, pressure_out = solution.pressure[first], solution.pressure[last]
    number = reynolds(network, solution, density)
    table = vessel_columns(network) | {
        "pressure_in_pa": pressure_in,
        "pressure_out_pa": pressure_out,
        "pressure_in_mmhg": pressure_in / PA_PER_MMHG,
        "pressure_out_mmhg": pressure_out / PA_PER_MMHG,
        "flow_ul_s": solution.flow,
        "flow_ml_min": solution.flow / UL_S_PER_ML_MIN,
        "velocity_mm_s": solution.velocity,
        "wall_shear_pa": solution.wall_shear,
        "wall_shear_dyn_cm2": solution.wall_shear * DYN_CM2_PER_PA,
        "resistance_pa_s_ul": solution.resistance,
        "reynolds": number,
        "poiseuille_holds": poiseuille_holds(network, number).astype(np.int64),
    }
    if solution.loss is not None:
        table["loss_pa"] = solution.loss
    if band is not None:
        table["wall_shear_band"] = classify_shear(solution, band)
    return table


def write_flow_csv(
    path: Path,
    network: VesselNetwork,
    solution: FlowSolution,
    band: ShearBand | None = None,
    density: float = WATER_DENSITY,
) -> None:
    """Write `flow_table` as CSV at full precision.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    table = flow_table(network, solution, density, band)
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
    write_text(path, out.getvalue())


def read_flow_csv(path: Path) -> list[dict[str, int | float | str]]:
    """Rows of a file that `write_flow_csv` wrote, values as they were."""
    with path.open(encoding="utf-8", newline="") as handle:
        return [
            {name: _value(text) for name, text in row.items()} for row in csv.DictReader(handle)
        ]


def _value(text: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


class FlowLimits(NamedTuple):
    """Where flow counts as laminar, developed, absurd, or inside a band."""

    laminar_reynolds: float = 2000.0
    """Below it pipe flow stays laminar."""
    entrance_share: float = 0.1
    """Share of a vessel that the flow may take to develop, for Poiseuille's law to hold."""
    absurd_mmhg: float = 100_000.0
    """Pressure drops above it, 13 MPa, come from a wrong unit and not from a perfusion."""
    inside_share: float = 0.9
    """Share of the wall's area inside the band for the whole to be called inside."""


LIMITS: Final = FlowLimits()


def question_pressure(drop_pa: float) -> None:
    """Refuse a pressure that no perfusion has.

    Raises
    ------
    FlowError
        When it is above `FlowLimits.absurd_mmhg`.
    """
    drop = abs(drop_pa) / PA_PER_MMHG
    if not drop <= LIMITS.absurd_mmhg:
        raise FlowError(
            f"the flow would take {drop:.3g} mmHg, above {LIMITS.absurd_mmhg:g}: is the network in "
            "another unit, the flow in µL/min, or the viscosity in Pa·s?"
        )


def reynolds(
    network: VesselNetwork, solution: FlowSolution, density: float = WATER_DENSITY
) -> FloatArray:
    """Reynolds number 8 ϱ v²/|τ_w| at the mean radius, (v,); ``density`` in Pa·s²/mm².

    For a Newtonian fluid it is ϱ |v| d/μ; for others that of Metzner & Reed 1955 (doi
    10.1002/aic.690010409), at which pipe flow has the friction of a Newtonian one's.
    """
    shear = np.abs(solution.wall_shear)
    moves = shear > 0.0
    number = np.zeros(network.vessel_count)
    number[moves] = 8.0 * density * solution.velocity[moves] ** 2 / shear[moves]
    return number


def entrance_share(network: VesselNetwork, reynolds_number: FloatArray) -> FloatArray:
    """Length in which a flat profile becomes parabolic over the vessel's length, (v,).

    L/d = (0.619^1.6 + (0.0567 Re)^1.6)^(1/1.6), laminar pipe flow, Durst et al. 2005,
    doi 10.1115/1.2063088. It is an upper bound where the flow comes developed from a vessel
    before.
    """
    diameters = (0.619**1.6 + (0.0567 * reynolds_number) ** 1.6) ** (1.0 / 1.6)
    return diameters * 2.0 * network.mean_radius() / network.lengths()


def poiseuille_holds(network: VesselNetwork, reynolds_number: FloatArray) -> np.ndarray:
    """Whether flow is laminar, and developed but for a tenth of the vessel, (v,) bool."""
    short = entrance_share(network, reynolds_number) <= LIMITS.entrance_share
    return short & (reynolds_number < LIMITS.laminar_reynolds)


PLACES: Final = ("below", "inside", "above")


@dataclass(frozen=True)
class ShearBand:
    """Least and greatest wall shear wanted, Pa; both belong to it."""

    low_pa: float
    high_pa: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.low_pa < self.high_pa < np.inf:
            raise FlowError(
                f"the band of wall shear goes from {self.low_pa:g} to {self.high_pa:g} Pa; give "
                "two rising numbers from 0 on"
            )


def classify_shear(solution: FlowSolution, band: ShearBand) -> NDArray[np.str_]:
    """Where each vessel's wall shear lies, (v,): below, inside or above."""
    shear = np.abs(solution.wall_shear)
    return np.array(PLACES)[(shear >= band.low_pa).astype(int) + (shear > band.high_pa)]


def band_summary(
    network: VesselNetwork, solution: FlowSolution, band: ShearBand
) -> dict[str, float | str]:
    """Shares of vessels, of their length and of their wall's area in, below and above the band.

    ``verdict`` is where `FlowLimits.inside_share` of the area lies, and ``mixed`` where nowhere
    does; wall shear is that at each vessel's mean radius.
    """
    where, measured = classify_shear(solution, band), integrals(network)
    amounts = {
        "vessels": np.ones(network.vessel_count),
        "length": measured[0],
        "area": measured[POWERS[1]],
    }
    summary: dict[str, float | str] = {
        "low_dyn_cm2": band.low_pa * DYN_CM2_PER_PA,
        "high_dyn_cm2": band.high_pa * DYN_CM2_PER_PA,
    }
    for name, amount in amounts.items():
        for place in PLACES:
            summary[f"{name}_{place}"] = float(amount[where == place].sum() / amount.sum())
    most = [place for place in PLACES if float(summary[f"area_{place}"]) >= LIMITS.inside_share]
    return summary | {"verdict": most[0] if most else "mixed"}
