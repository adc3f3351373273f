"""A recipe's words on pulsatile flow in the design's units."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from design.hemodynamics import (
    GelWall,
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
    RigidWall,
    ThinWall,
    WindkesselOutlet,
)
from design.hemodynamics.waveforms import Constant, Sine, Waveform, read_waveform, shape
from design.hemodynamics.waveforms.waveform import cycle_times
from design.units import PA_PER_MMHG, UL_S_PER_ML_MIN
from printctl.errors import UsageError
from printctl.recipe.parts import FlowPart
from printctl.recipe.pulse import PulseOutlet, PulsePart

_MEAN: Final = 0.01
_RESISTANCE: Final = PA_PER_MMHG / UL_S_PER_ML_MIN
_COMPLIANCE: Final = 1000.0 / PA_PER_MMHG


def pulsatile_conditions(
    part: FlowPart, pulse: PulsePart, folder: Path, print_scale: float = 1.0
) -> PulsatileConditions:
    """Conditions of a print ``print_scale`` times the design's size, at the design's wall shear.

    Flows grow by the scale's third power and pressures stay; so resistances of outlets fall and
    their compliances grow by it. A table's name is relative to ``folder``.

    Raises
    ------
    UsageError
        For a table whose mean isn't the recipe's flow.
    FlowError, OSError
        For a table that is no waveform, or can't be read.
    """
    volume = print_scale**3
    return PulsatileConditions(
        viscosity_pa_s=part.viscosity_mpa_s * 1e-3,
        inlet=_wave(part.inlet_flow_ml_min, pulse, folder, UL_S_PER_ML_MIN * volume),
        outlet=_outlet(pulse.outlet, part.outlet_pressure_mmhg * PA_PER_MMHG, volume),
        wall=_wall(pulse, print_scale),
        profile=pulse.profile,
    )


def _wave(mean: float, pulse: PulsePart, folder: Path, scale: float) -> Waveform:
    if pulse.table is not None:
        return _table(folder / pulse.table, mean, pulse, scale)
    period = pulse.period_s or 1.0
    if pulse.shape is not None:
        return shape(pulse.shape, mean * scale, period)
    return Sine(mean * scale, (pulse.amplitude_ml_min or 0.0) * scale, period)


def _table(path: Path, mean: float, pulse: PulsePart, scale: float) -> Waveform:
    wave = read_waveform(path, "flow_ml_min", scale, pulse.period_s)
    found = float(wave.at(cycle_times(wave.period_s, 2000)).mean()) / scale
    if abs(found - mean) > _MEAN * abs(mean):
        raise UsageError(
            f"{path}: the flow's mean is {found:.4g} mL/min, and inlet_flow_ml_min is {mean:g}; "
            f"set inlet_flow_ml_min: {found:.4g}, or scale the table"
        )
    return wave


def _outlet(
    given: PulseOutlet | None, distal_pa: float, volume: float
) -> PressureOutlet | ResistanceOutlet | WindkesselOutlet:
    if given is None:
        return PressureOutlet(Constant(distal_pa))
    resistance = given.resistance_mmhg_min_ml * _RESISTANCE / volume
    if given.proximal_mmhg_min_ml is None or given.compliance_ml_mmhg is None:
        return ResistanceOutlet(resistance, distal_pa)
    proximal = given.proximal_mmhg_min_ml * _RESISTANCE / volume
    compliance = given.compliance_ml_mmhg * _COMPLIANCE * volume
    return WindkesselOutlet(proximal, compliance, resistance, distal_pa)


def _wall(pulse: PulsePart, scale: float) -> RigidWall | GelWall | ThinWall:
    if pulse.wall_young_kpa is None:
        return RigidWall()
    young = pulse.wall_young_kpa * 1e3
    if pulse.wall_thickness_mm is None:
        return GelWall(young)
    return ThinWall(young, pulse.wall_thickness_mm * scale)
