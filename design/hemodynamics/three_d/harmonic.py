"""Solve pulsatile Stokes flow in a 3D lumen, harmonic by harmonic.

Without convection the problem is linear, so that u(t) = Re Σ u_k exp(i ω_k t) with i ω_k ϱ in
place of the derivative in time: the periodic state itself, without time steps and their error. It
holds for slow flow in narrow lumens (Reynolds number well below 1, or straight pipes).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.hemodynamics.three_d.bordered import BorderBlocks, solve_bordered
from design.hemodynamics.three_d.engine import engine_threads
from design.hemodynamics.three_d.engine_mesh import engine_mesh
from design.hemodynamics.three_d.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.memory import check_memory
from design.hemodynamics.three_d.options import FlowOptions
from design.hemodynamics.three_d.port_plan import GivenFlow, Law, PortPlan, pulsatile_plan
from design.hemodynamics.three_d.port_profile import unit_profile
from design.hemodynamics.three_d.record import Record, Stepping
from design.hemodynamics.three_d.sections import Section
from design.hemodynamics.three_d.solution import ThreeDWaves
from design.hemodynamics.three_d.steady import columns_of
from design.hemodynamics.three_d.stokes import Spaces, Stokes, spaces
from design.hemodynamics.waveforms import Waveform
from design.hemodynamics.waveforms.waveform import common_period, cycle_times, harmonics_of
from design.hemodynamics.zero_d.pulsatile.conditions import PulsatileConditions, ResistanceOutlet

ComplexArray = NDArray[np.complex128]

_RTOL = 1e-10


def solve_harmonics(
    mesh: LumenMesh,
    conditions: PulsatileConditions,
    options: FlowOptions | None = None,
    stepping: Stepping | None = None,
    sections: Sequence[Section] = (),
) -> ThreeDWaves:
    """Find the periodic state of Stokes flow in a lumen of rigid wall.

    ``stepping.steps`` are the times told of; harmonics that these resolve are kept. The rest as
    `march_flow`.

    Raises
    ------
    FlowError
        As `march_flow`; convection asked for.
    """
    how, clock = options or FlowOptions(convection=False), stepping or Stepping()
    if how.convection:
        raise FlowError("harmonics are of Stokes flow; set convection=False, or step through time")
    plan = pulsatile_plan(mesh, conditions)
    check_memory(mesh, how, 2.0)
    period = common_period(plan.waveforms())
    if period is None:
        raise FlowError("nothing changes in time: all waveforms are constant; solve_steady does it")
    with engine_threads(how.threads) as ng:
        room = spaces(ng, engine_mesh(ng, mesh), len(mesh.ports), how.order, plan.inflow)
        number = _numbers(plan, period, clock.steps)
        omega = 2.0 * np.pi * number / period
        amplitudes = [
            _one(
                room, mesh, plan, float(w), lambda wave, n=n: _phasor(wave, period, clock.steps, n)
            )
            for n, w in zip(number, omega, strict=True)
        ]
        record, times = Record(room, mesh, clock, sections), cycle_times(period, clock.steps)
        for k, time in enumerate(times):
            record.keep(k, (np.exp(1j * omega * time) @ np.array(amplitudes)).real)
        return record.waves(times, np.zeros(0))


def _numbers(plan: PortPlan, period: float, steps: int) -> NDArray[np.int64]:
    return harmonics_of(list(plan.waveforms()), period, steps)[0]


def _phasor(waveform: Waveform, period: float, steps: int, number: int) -> complex:
    numbers, (phasors,) = harmonics_of([waveform], period, steps)
    return complex(phasors[numbers == number].sum())


def _one(room: Spaces, mesh: LumenMesh, plan: PortPlan, omega: float, phasor: Any) -> ComplexArray:
    """Unknowns of one harmonic, (n,)."""
    rate = 1j * omega * plan.density
    stokes = Stokes(room, plan.viscosity_pa_s, rate if omega else 0.0)
    laws = [_law(c.law, omega, phasor) for c in plan.coupled]
    slope: NDArray[Any]
    given: NDArray[Any]
    slope, given = np.array(laws, dtype=np.complex128).reshape(-1, 2).T
    start: NDArray[Any] = np.zeros(room.count, dtype=np.complex128)
    if plan.inflow is not None:
        speed = rate / plan.viscosity_pa_s if plan.womersley else 0.0
        start = phasor(plan.flow) * unit_profile(room, mesh, plan.inflow, speed)
    load: NDArray[Any] = np.zeros(room.count, dtype=np.complex128)
    for port, waveform in plan.held:
        load -= phasor(waveform) * room.outward[port]
    if not omega:
        start, load, slope, given = (x.real for x in (start, load, slope, given))
    border = BorderBlocks.around(stokes.solve, columns_of(room, plan), slope, room.free)
    right = np.concatenate([room.free * (load - stokes.times(start)), given])
    unknowns, _ = solve_bordered(stokes.times, stokes.solve, border, right, room.free, _RTOL)
    return np.asarray(start + unknowns[: room.count], dtype=np.complex128)


def _law(law: Law, omega: float, phasor: Any) -> tuple[complex, complex]:
    """D and s of Q - D p = s."""
    if isinstance(law, GivenFlow):
        return 0.0, law.factor * phasor(law.waveform)
    if isinstance(law, ResistanceOutlet):
        impedance: complex = law.resistance
    else:
        impedance = law.proximal + law.distal / (1.0 + 1j * omega * law.distal * law.compliance)
    return 1.0 / impedance, 0.0 if omega else -law.distal_pa / impedance
