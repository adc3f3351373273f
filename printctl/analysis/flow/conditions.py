"""Convert a recipe's flow section to the solvers' boundary conditions, fluid and units."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from design.hemodynamics import (
    Carreau,
    FlowConditions,
    Fluid,
    GelWall,
    Losses,
    PowerLaw,
    Pries1994,
    PulsatileConditions,
    RigidWall,
    Stenosis,
    Supply,
    ThinWall,
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
from design.network import VesselNetwork
from design.units import PA_PER_MMHG, PA_S2_MM2_PER_G_CM3, UL_S_PER_ML_MIN
from printctl.analysis.flow.outlets import Outlet, outlet_of, read_outlets, steady_of
from printctl.errors import UsageError
from printctl.recipe.fluids import CarreauPart, FluidPart, LossPart, PowerLawPart
from printctl.recipe.parts import FlowPart
from printctl.recipe.pulse import PulsePart

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
        For a tree that the network lacks, or that has no inlet.
    """
    if not part.supplies or network is None:
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
    return tuple(supplies)


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
