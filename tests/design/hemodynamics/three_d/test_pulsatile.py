"""Pulsatile 3D flow, against Womersley's, a Windkessel computed by hand, and the slow limit."""

import numpy as np
import pytest

from kernels.arrays import FloatArray

pytest.importorskip("ngsolve", reason='the extra "flow3d" isn\'t installed')

from design.errors import FlowError
from design.hemodynamics import PulsatileConditions, WindkesselOutlet
from design.hemodynamics.probes import probes_along
from design.hemodynamics.three_d import (
    FlowOptions,
    Stepping,
    march_flow,
    sections_at,
)
from design.hemodynamics.vessel_coefficients import impedance_factor, womersley_number
from design.hemodynamics.waveforms import Constant, Sine
from tests.design.hemodynamics.networks import network_of
from tests.design.hemodynamics.three_d.lumens import beside, pipe

MU, RADIUS, LENGTH = 1e-3, 0.5, 2.0
RESISTANCE = 8.0 * MU * LENGTH / (np.pi * RADIUS**4)


def _first(values: FloatArray) -> complex:
    return complex(2.0 * np.fft.rfft(values)[1] / len(values))


def _pulse(period: float, **more: object) -> PulsatileConditions:
    return PulsatileConditions(MU, Sine(4.0, 2.0, period), profile="womersley", **more)  # type: ignore[arg-type]


def test_steps_converge_to_womersley_with_second_order() -> None:
    period, mesh = 0.1, pipe(1, 2, RADIUS, LENGTH)
    number = womersley_number(np.array([RADIUS]), 2.0 * np.pi / period, MU)
    assert number[0] == pytest.approx(4.08, rel=0.01)
    exact = RESISTANCE * complex(impedance_factor(number)[0]) * -2.0j
    error = []
    for steps in (16, 32):
        found = march_flow(mesh, _pulse(period), FlowOptions(3), Stepping(steps))
        drop = found.port_pressure[0] - found.port_pressure[1]
        error.append(abs(_first(drop) / exact - 1.0))
    assert found.change[-1] <= 1e-4
    assert error[1] < 0.015
    assert 1.6 < np.log2(error[0] / error[1]) < 2.4
    assert drop.mean() == pytest.approx(4.0 * RESISTANCE, rel=1e-2)


def test_a_slow_pulse_follows_poiseuille_at_every_time() -> None:
    mesh = pipe(1, 2, RADIUS, LENGTH)
    found = march_flow(mesh, _pulse(50.0), FlowOptions(3), Stepping(16))
    drop = found.port_pressure[0] - found.port_pressure[1]
    assert drop == pytest.approx(RESISTANCE * -found.port_flow[0], rel=1e-2)


def test_a_windkessel_answers_with_its_impedance() -> None:
    """p = Z Q at the first harmonic, (R_p + R_d) Q at the mean."""
    outlet = WindkesselOutlet(0.05, 0.2, 0.4, distal_pa=3.0)
    pulse, mesh = _pulse(0.5, outlet=outlet), pipe(1, 2, RADIUS, LENGTH)
    turn = 2.0j * np.pi / 0.5
    network = network_of([[0, 0, 0], [0, 0, LENGTH]], [(0, 1)], RADIUS)
    places = sections_at(network, probes_along(0, 2), mesh, 2)
    impedance = outlet.proximal + outlet.distal / (1.0 + turn * outlet.distal * outlet.compliance)
    found = march_flow(mesh, pulse, FlowOptions(2), Stepping(40), places)
    flow, pressure = found.port_flow[1], found.port_pressure[1]
    assert abs(_first(pressure) / (impedance * _first(flow)) - 1.0) < 6e-3
    # The wall is rigid: flow is the same all along, and pressure falls on the way.
    assert found.section_flow == pytest.approx(np.stack([flow, flow]), abs=3e-3 * flow.max())
    assert np.all(np.diff(found.section_pressure.mean(axis=1)) < 0.0)
    assert pressure.mean() == pytest.approx(3.0 + 0.45 * flow.mean(), rel=1e-3)


def test_slow_windkessels_are_periodic_in_a_few_cycles() -> None:
    """One of 160 periods, and two side by side of 48 and 5, whose flows differ from the steady."""
    slow = WindkesselOutlet(0.05, 40.0, 0.4)
    mesh = pipe(1, 2, RADIUS, LENGTH)
    found = march_flow(mesh, _pulse(0.1, outlet=slow), FlowOptions(2), Stepping(8, cycles=4))
    assert found.port_pressure[1].mean() == pytest.approx(0.45 * 4.0, rel=1e-3)
    two = beside(mesh, pipe(1, 2, RADIUS, LENGTH), np.array([3.0, 0.0, 0.0]))
    outlets = {1: WindkesselOutlet(0.05, 4.0, 1.2), 3: WindkesselOutlet(0.5, 0.5, 1.0)}
    found = march_flow(two, _pulse(0.1, outlet=outlets), FlowOptions(2), Stepping(8, cycles=8))
    for port, law in ((1, outlets[1]), (3, outlets[3])):
        whole = law.proximal + law.distal
        mean = found.port_flow[port].mean()
        assert found.port_pressure[port].mean() == pytest.approx(whole * mean, rel=2e-3)


def test_what_has_no_periodic_state_is_refused() -> None:
    mesh = pipe(1, 2, RADIUS, LENGTH)
    with pytest.raises(FlowError, match=r"no periodic state after 1 cycles: .*most_cycles"):
        march_flow(mesh, _pulse(0.1), FlowOptions(2), Stepping(8, cycles=1))
    with pytest.raises(
        FlowError, match=r"no periodic state in 3 cycles of 0\.001 s: .* more than \d+"
    ):
        march_flow(mesh, _pulse(0.001), FlowOptions(2), Stepping(8, cycles=3))
    with pytest.raises(FlowError, match="nothing changes in time"):
        march_flow(mesh, PulsatileConditions(MU, Constant(1.0)))
