"""Frames of a pulse through a network: pressure or flow over a cycle, by 0D or 1D."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from design.geometry.polyline import arc_lengths
from design.hemodynamics import (
    PulsatileConditions,
    pulsatile_at_probes,
    solve_one_d,
    solve_pulsatile,
)
from design.hemodynamics.probes import Probes, ProbeWaves
from design.network import VesselNetwork
from design.units import PA_PER_MMHG, UL_S_PER_ML_MIN
from kernels.arrays import FloatArray
from printctl.analysis.film.film_file import Frame
from printctl.analysis.flow import one_d_options, pulsatile_conditions
from printctl.errors import UsageError
from printctl.recipe import Recipe
from printctl.recipe.parts import OneDPart
from registration.report.picture import DrivingWave, FilmScene, Quantity, magnitude

_WAVE = 200
"""Points of the inlet's wave as it is drawn."""

_MMHG_FROM = 1.0
"""Pulses of less pressure than this, mmHg, are shown in Pa."""


@dataclass(frozen=True)
class PulseFilm:
    """Settings of a film of a pulse.

    Attributes
    ----------
    shown : "pressure" or "flow"
    solver : "0d" or "1d"
    frames : int
        Of a cycle.
    cycles : int
        The film's length.
    """

    shown: Literal["pressure", "flow"] = "pressure"
    solver: Literal["0d", "1d"] = "0d"
    frames: int = 50
    cycles: int = 2


def pulse_frames(
    scene: FilmScene, recipe: Recipe, tables: Path, film: PulseFilm
) -> Iterator[Frame]:
    """Solve for the periodic state that the recipe asks for, and draw it over its cycles.

    Parameters
    ----------
    scene : FilmScene
        Of the run's network.
    recipe : Recipe
        With ``flow.pulse``; ``tables`` is the folder that names of its tables are relative to.

    Raises
    ------
    UsageError
        Without a pulse, or for 1D without walls that give way.
    FlowError, OSError
        As the solvers, and for tables that can't be read.
    """
    network, pulse = scene.whole, recipe.flow.pulse
    if pulse is None:
        raise UsageError(
            "the run's recipe has no pulse to film; add flow: {pulse: ...} and run it again, or "
            "film --show growth"
        )
    conditions = pulsatile_conditions(recipe.flow, pulse, tables, recipe.print_scale, network)
    places = _places(network)
    waves = _solved(network, conditions, recipe.flow.one_d, places, film)
    quantity = _quantity(waves, film.shown)
    driving = _driving(conditions)
    cycle = []
    for k, time in enumerate(waves.time_s.tolist()):
        now = replace(quantity, values=quantity.values[:, k])
        caption = f"{film.solver.upper()} flow, t = {time:.3f} s of {driving.period_s:g} s"
        above = scene.frame(network, now, caption)
        below = scene.strip(driving, time)
        cycle.append(np.vstack([above, _as_wide(below, above.shape[1])]))
        yield cycle[-1]
    for _ in range(film.cycles - 1):
        yield from cycle


def _as_wide(strip: Frame, width: int) -> Frame:
    return strip[:, :width]


def _places(network: VesselNetwork) -> Probes:
    """Every point of the polylines."""
    vessel = np.repeat(np.arange(network.vessel_count), np.diff(network.offset))
    along = arc_lengths(network.points)
    begin, end = along[network.offset[:-1]], along[network.offset[1:] - 1]
    share = (along - begin[vessel]) / (end - begin)[vessel]
    return Probes(vessel, np.clip(share, 0.0, 1.0))


def _solved(
    network: VesselNetwork,
    conditions: PulsatileConditions,
    part: OneDPart | None,
    places: Probes,
    film: PulseFilm,
) -> ProbeWaves:
    if film.solver == "0d":
        solution = solve_pulsatile(network, conditions, 2 * film.frames)
        return pulsatile_at_probes(network, solution, conditions, places, film.frames)
    options = replace(one_d_options(part or OneDPart(), film.frames), probes=places)
    waves = solve_one_d(network, conditions, options).probes
    if waves is None:
        raise UsageError("1D flow gave no waves along the vessels; film --solver 0d")
    return waves


def _quantity(waves: ProbeWaves, shown: str) -> Quantity:
    """The values (p, t), on one scale for all times."""
    quantity: Quantity | None
    if shown == "flow":
        quantity = magnitude("flow", "Flow", "mL/min", np.abs(waves.flow) / UL_S_PER_ML_MIN)
    else:
        low = float(np.abs(waves.pressure).max()) < _MMHG_FROM * PA_PER_MMHG
        values: FloatArray = waves.pressure if low else waves.pressure / PA_PER_MMHG
        quantity = magnitude("pressure", "Pressure", "Pa" if low else "mmHg", values, log=False)
    if quantity is None:
        raise UsageError("the pulse has no number to show; check flow.pulse")
    return quantity


def _driving(conditions: PulsatileConditions) -> DrivingWave:
    """What drives the inlets."""
    period = conditions.inlet.period_s or 1.0
    time = period * np.arange(_WAVE) / _WAVE
    by_flow = conditions.inlet_is == "flow"
    unit = UL_S_PER_ML_MIN if by_flow else PA_PER_MMHG
    title = "Inlet flow / mL/min" if by_flow else "Inlet pressure / mmHg"
    return DrivingWave(time, conditions.inlet.at(time) / unit, title, period)
