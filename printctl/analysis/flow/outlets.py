"""Outlet boundary conditions (pressure, resistance, Windkessel) from a recipe or a CSV file."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from design.hemodynamics import (
    Carreau,
    FlowConditions,
    Fluid,
    GelWall,
    Losses,
    OutletLoad,
    PowerLaw,
    PressureOutlet,
    Pries1994,
    PulsatileConditions,
    ResistanceOutlet,
    RigidWall,
    Stenosis,
    Supply,
    ThinWall,
    WindkesselOutlet,
)
from design.hemodynamics.waveforms import (
    Constant,
    Sine,
    Tabulated,
    Waveform,
    cycle_times,
    read_waveform,
    shape,
)
from design.network import VesselKind, VesselNetwork
from design.units import PA_PER_MMHG, PA_S2_MM2_PER_G_CM3, UL_S_PER_ML_MIN
from kernels.arrays import IntArray
from printctl.errors import UsageError
from printctl.recipe.parts import (
    CarreauPart,
    FlowPart,
    FluidPart,
    LossPart,
    PowerLawPart,
    PulseOutlet,
    PulsePart,
)

Outlet = PressureOutlet | ResistanceOutlet | WindkesselOutlet
_RESISTANCE: Final = PA_PER_MMHG / UL_S_PER_ML_MIN
_COMPLIANCE: Final = 1000.0 / PA_PER_MMHG
_VALUES: Final = (
    "pressure_mmhg", "resistance_mmhg_min_ml", "proximal_mmhg_min_ml", "compliance_ml_mmhg",
)  # fmt: skip


def outlet_of(given: PulseOutlet | None, distal_pa: float, volume: float = 1.0) -> Outlet:
    """Outlet condition in the design's units, of a print ``volume`` times the size."""
    if given is None:
        return PressureOutlet(Constant(distal_pa))
    resistance = given.resistance_mmhg_min_ml * _RESISTANCE / volume
    if given.proximal_mmhg_min_ml is None or given.compliance_ml_mmhg is None:
        return ResistanceOutlet(resistance, distal_pa)
    proximal = given.proximal_mmhg_min_ml * _RESISTANCE / volume
    compliance = given.compliance_ml_mmhg * _COMPLIANCE * volume
    return WindkesselOutlet(proximal, compliance, resistance, distal_pa)


def steady_of(outlet: Outlet) -> OutletLoad:
    """The same in steady flow."""
    if isinstance(outlet, ResistanceOutlet):
        return OutletLoad(outlet.resistance, outlet.distal_pa)
    if isinstance(outlet, WindkesselOutlet):
        return OutletLoad(outlet.proximal + outlet.distal, outlet.distal_pa)
    return OutletLoad(0.0, float(outlet.waveform.at(np.zeros(1))[0]))


def read_outlets(path: Path, network: VesselNetwork, volume: float = 1.0) -> dict[int, Outlet]:
    """Read a row for each outlet of ``network``, whose other numbers are those of a recipe.

    Raises
    ------
    UsageError
        For a missing or unknown column, a cell that is no number, a row that isn't an outlet's or
        is its second, an outlet without a row.
    OSError
        When the file can't be read.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as handle:
            reader = csv.DictReader(handle)
            rows, names = list(reader), reader.fieldnames or []
    except (UnicodeDecodeError, csv.Error) as exc:
        raise UsageError(f"{path} isn't a CSV file: {exc}") from exc
    key = next((name for name in ("node", "vessel") if name in names), None)
    strange = [name for name in names if name not in ("node", "vessel", *_VALUES)]
    if key is None or strange:
        wrong = f"has a column {strange[0]!r}" if strange else "has no column node or vessel"
        raise UsageError(f"{path} {wrong}; its first line names node,{','.join(_VALUES)}")
    ends = network.outlets()
    outlets: dict[int, Outlet] = {}
    for line, row in enumerate(rows, 2):
        place = f"{path}, line {line}"
        node = _node(place, key, row, network)
        if node not in ends or node in outlets:
            wrong = "has a row already" if node in outlets else "isn't one of the outlets"
            raise UsageError(f"{place}: {key} {row[key]} {wrong}; outlets are the nodes "
                             f"{', '.join(map(str, ends[:8]))}")  # fmt: skip
        outlets[node] = _row(place, row, volume)
    bare = [int(node) for node in ends if node not in outlets]
    if bare:
        raise UsageError(
            f"{path}: outlet {bare[0]} has no condition ({len(bare)} of {len(ends)} such); give it "
            "a row with its pressure or resistance"
        )
    return outlets


def _node(place: str, key: str, row: Mapping[str, str], network: VesselNetwork) -> int:
    number = _number(place, key, row)
    if number is None or number != int(number) or number < 0:
        raise UsageError(f"{place}: {key} {row[key]!r} is no number of a {key}")
    if key == "node":
        return int(number)
    if number >= network.vessel_count:
        raise UsageError(
            f"{place}: there is no vessel {int(number)}; the network has 0 to "
            f"{network.vessel_count - 1}"
        )
    return int(network.vessel_nodes[int(number), 1])


def _row(place: str, row: Mapping[str, str], volume: float) -> Outlet:
    pressure, *rest = (_number(place, name, row) for name in _VALUES)
    resistance, proximal, compliance = rest
    if resistance is None:
        if pressure is None or proximal is not None or compliance is not None:
            raise UsageError(f"{place}: give pressure_mmhg or resistance_mmhg_min_ml")
        return PressureOutlet(Constant(pressure * PA_PER_MMHG))
    if (proximal is None) != (compliance is None):
        raise UsageError(f"{place}: a Windkessel has proximal_mmhg_min_ml, compliance_ml_mmhg and "
                         "resistance_mmhg_min_ml; give all three, or the last alone")  # fmt: skip
    for name, value in zip(_VALUES[1:], rest, strict=True):
        if value is not None and value <= 0.0:
            raise UsageError(f"{place}: {name} is {value:g}; give a number above 0")
    given = PulseOutlet(
        resistance_mmhg_min_ml=resistance,
        proximal_mmhg_min_ml=proximal,
        compliance_ml_mmhg=compliance,
    )
    return outlet_of(given, (pressure or 0.0) * PA_PER_MMHG, volume)


def _number(place: str, name: str, row: Mapping[str, str]) -> float | None:
    text = (row.get(name) or "").strip()
    if not text:
        return None
    try:
        value = float(text)
    except ValueError as exc:
        raise UsageError(f"{place}: {name} {text!r} is no number") from exc
    if not np.isfinite(value):
        raise UsageError(f"{place}: {name} is {text}; give a number")
    return value


_MEAN: Final = 0.01


def steady_conditions(
    part: FlowPart, folder: Path = Path(), network: VesselNetwork | None = None
) -> FlowConditions:
    """Conditions of the design's size; ``network`` is needed where something is behind outlets.

    Raises
    ------
    UsageError, OSError
        For a table of outlets that can't be read, or isn't one.
    """
    by_flow = part.inlet_pressure_mmhg is None
    behind: Mapping[int, Outlet] = {}
    if network is not None:
        said = part.every_outlet
        every = None if said is None else outlet_of(said, _distal(part))
        outlets = _outlets(part, every, folder, network, 1.0)
        nodes = network.outlets().tolist()
        if outlets is not None:
            behind = outlets if isinstance(outlets, Mapping) else dict.fromkeys(nodes, outlets)
    return FlowConditions(
        viscosity_pa_s=part.viscosity_mpa_s * 1e-3,
        inlet_flow_ul_s=part.inlet_flow_ml_min * UL_S_PER_ML_MIN if by_flow else None,
        inlet_pressure_pa=None if by_flow else (part.inlet_pressure_mmhg or 0.0) * PA_PER_MMHG,
        outlet_pressure_pa=_distal(part),
        fluid=None if part.viscosity is None else fluid_of(part.viscosity),
        losses=losses_of(part.losses),
        behind={node: steady_of(outlet) for node, outlet in behind.items()},
        density=part.density_g_cm3 * PA_S2_MM2_PER_G_CM3,
        supplies=supplies_of(part, network),
    )


def supplies_of(
    part: FlowPart, network: VesselNetwork | None, volume: float = 1.0
) -> tuple[Supply, ...]:
    """Supplies of single trees, at their inlets; of a print ``volume`` times the design's size.

    Raises
    ------
    UsageError
        For a tree that the network lacks, or that has no inlet; for a vein without artery whose
        flow isn't known, as pressure drives the arteries.
    """
    if network is None:
        return ()
    inlets = set(network.inlets().tolist())
    of_inlet = {
        node: tree
        for node, tree in zip(
            network.vessel_nodes[:, 0].tolist(), network.tree.tolist(), strict=True
        )
        if node in inlets
    }
    supplies = []
    for number, supply in enumerate(part.supplies):
        lacking = sorted(set(supply.trees) - set(of_inlet.values()))
        if lacking:
            raise UsageError(
                f"flow.supplies.{number}: tree {lacking[0]} has no inlet; trees that have one are "
                f"{', '.join(map(str, sorted(set(of_inlet.values()))))}"
            )
        nodes = tuple(node for node, tree in of_inlet.items() if tree in supply.trees)
        supplies.append(Supply(nodes, supply.flow_ml_min * UL_S_PER_ML_MIN * volume))
    return (*supplies, *_supply_of_veins(part, network, supplies, volume))


def _supply_of_veins(
    part: FlowPart, network: VesselNetwork, supplies: list[Supply], volume: float
) -> list[Supply]:
    """Return the supply of veins that no artery joins and no supply names: all that comes in."""
    named = [node for supply in supplies for node in supply.inlets]
    veins, fed = _vein_inlets(network)
    nodes = veins[~np.isin(veins, named)]
    if not len(nodes) or np.isin(fed, named).all() or np.isin(veins, named).any():
        return []
    if part.inlet_pressure_mmhg is not None:
        tree = network.tree[np.isin(network.vessel_nodes[:, 0], nodes)].min()
        raise UsageError(
            f"tree {tree} is a vein that no artery joins: its flow comes from the tissue, and "
            "inlet_pressure_mmhg doesn't say how much; give inlet_flow_ml_min, or add "
            f"flow: {{supplies: [{{trees: [{tree}], flow_ml_min: ...}}]}}"
        )
    brought = part.inlet_flow_ml_min * UL_S_PER_ML_MIN * volume
    brought += sum(supply.flow_ul_s for supply in supplies)
    return [Supply(tuple(nodes.tolist()), brought)]


def _vein_inlets(network: VesselNetwork) -> tuple[IntArray, IntArray]:
    """Return inlets of parts that are veins throughout, and all other inlets."""
    count = len(network.nodes)
    links = coo_array((np.ones(network.vessel_count), network.vessel_nodes.T), (count, count))
    part = connected_components(links, directed=False)[1]
    mixed = part[network.vessel_nodes[network.kind != VesselKind.VEIN, 0]]
    inlets = network.inlets()
    veins = ~np.isin(part[inlets], mixed)
    return inlets[veins], inlets[~veins]


def fluid_of(part: FluidPart) -> Fluid:
    """The fluid of a recipe."""
    if isinstance(part, CarreauPart):
        return Carreau(
            part.zero_shear_mpa_s * 1e-3,
            part.infinite_shear_mpa_s * 1e-3,
            part.time_s,
            part.index,
            part.yasuda,
        )
    if isinstance(part, PowerLawPart):
        return PowerLaw(part.consistency_mpa_sn * 1e-3, part.index)
    return Pries1994(part.wide_mpa_s * 1e-3, part.haematocrit)


def losses_of(part: LossPart) -> Losses:
    """The losses of a recipe."""
    stenoses = (Stenosis(s.vessel, s.diameter_share, s.length_mm) for s in part.stenoses)
    return Losses(part.junction_k, tuple(stenoses))


def pulsatile_conditions(
    part: FlowPart,
    pulse: PulsePart | None,
    folder: Path,
    print_scale: float = 1.0,
    network: VesselNetwork | None = None,
) -> PulsatileConditions:
    """Conditions of a print ``print_scale`` times the design's size, at the design's wall shear.

    Flows grow by the scale's third power and pressures stay; so resistances of outlets fall and
    their compliances grow by it. Tables' names are relative to ``folder``; ``network`` is needed
    for one of outlets. Without a ``pulse`` the inlet is constant.

    Raises
    ------
    UsageError
        For a table whose mean isn't the recipe's, or a table of outlets that isn't one.
    FlowInputError, OSError
        For a table that is no waveform, or can't be read.
    """
    volume = print_scale**3
    every = outlet_of(part.every_outlet, _distal(part), volume)
    outlets = None if network is None else _outlets(part, every, folder, network, volume)
    return PulsatileConditions(
        viscosity_pa_s=part.viscosity_mpa_s * 1e-3,
        inlet=_wave(part, pulse, folder, volume),
        inlet_is="flow" if part.inlet_pressure_mmhg is None else "pressure",
        outlet=every if outlets is None else outlets,
        wall=RigidWall() if pulse is None else _wall(pulse, print_scale),
        profile="poiseuille" if pulse is None else pulse.profile,
        density=part.density_g_cm3 * PA_S2_MM2_PER_G_CM3,
        supplies=supplies_of(part, network, volume),
    )


def _distal(part: FlowPart) -> float:
    return part.outlet_pressure_mmhg * PA_PER_MMHG


def _outlets(
    part: FlowPart, every: Outlet | None, folder: Path, network: VesselNetwork, volume: float
) -> Outlet | Mapping[int, Outlet] | None:
    if part.outlets is None:
        return every
    return read_outlets(folder / part.outlets, network, volume)


def _wave(part: FlowPart, pulse: PulsePart | None, folder: Path, volume: float) -> Waveform:
    """The inlet's flow in µL/s, or its pressure in Pa."""
    if part.inlet_pressure_mmhg is None:
        mean, scale, swing = part.inlet_flow_ml_min, UL_S_PER_ML_MIN * volume, "amplitude_ml_min"
    else:
        mean, scale, swing = part.inlet_pressure_mmhg, PA_PER_MMHG, "amplitude_mmhg"
    if pulse is None:
        return Constant(mean * scale)
    if pulse.table is not None:
        by_flow = part.inlet_pressure_mmhg is None
        return _table(folder / pulse.table, mean, pulse, scale, by_flow=by_flow)
    period = pulse.period_s or 1.0
    if pulse.shape is not None:
        return shape(pulse.shape, mean * scale, period)
    return Sine(mean * scale, (getattr(pulse, swing) or 0.0) * scale, period)


def _table(path: Path, mean: float, pulse: PulsePart, scale: float, *, by_flow: bool) -> Waveform:
    column, key, unit = (
        ("flow_ml_min", "inlet_flow_ml_min", "mL/min")
        if by_flow
        else ("pressure_mmhg", "inlet_pressure_mmhg", "mmHg")
    )
    wave = read_waveform(path, column, scale, pulse.period_s)
    if by_flow:
        _refuse_backflow(path, wave, scale)
    table_mean = float(wave.at(cycle_times(wave.period_s, 2000)).mean()) / scale
    if abs(table_mean - mean) > _MEAN * abs(mean):
        raise UsageError(
            f"{path}: the {column.split('_')[0]}'s mean is {table_mean:.4g} {unit}, and {key} is "
            f"{mean:g}; set {key}: {table_mean:.4g}, or scale the table"
        )
    return wave


def _refuse_backflow(path: Path, wave: Tabulated, scale: float) -> None:
    least = int(wave.samples.argmin())
    if wave.samples[least] < 0.0:
        raise UsageError(
            f"{path}: sample {least + 1} is {wave.samples[least] / scale:.4g} mL/min: the flow "
            "goes back out of the inlet; correct it, or drive the inlet by pressure"
        )


def _wall(pulse: PulsePart, scale: float) -> RigidWall | GelWall | ThinWall:
    if pulse.wall_young_kpa is None:
        return RigidWall()
    young = pulse.wall_young_kpa * 1e3
    if pulse.wall_thickness_mm is None:
        return GelWall(young)
    return ThinWall(young, pulse.wall_thickness_mm * scale)
