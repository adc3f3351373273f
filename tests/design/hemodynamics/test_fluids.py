"""Non-Newtonian fluids in tubes and in networks."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from design.errors import FlowError
from design.hemodynamics import (
    Carreau,
    FlowConditions,
    Newtonian,
    PowerLaw,
    Pries1994,
    flow_summary,
    solve_flow,
)
from design.network import VesselNetwork
from tests.design.hemodynamics.networks import VISCOSITY, network_of, random_tree

BLOOD = Carreau()


def _tube_flow(fluid: Carreau, radius: float, gradient: float) -> float:
    """Flow by the velocity profile itself: Q = π ∫ r² γ̇ dr with τ = r G/2, γ̇ solved for."""

    def rate(r: float) -> float:
        stress = gradient * r / 2.0
        return float(brentq(lambda g: g * float(fluid.viscosity(np.array(g))) - stress, 0.0, 1e12))

    return float(np.pi * quad(lambda r: r**2 * rate(r), 0.0, radius, epsrel=1e-10)[0])


@pytest.mark.parametrize("gradient", [0.01, 1.0, 30.0, 1000.0])
def test_carreau_in_a_tube_is_its_velocity_profile_integrated(gradient: float) -> None:
    radius = 0.3
    flow = _tube_flow(BLOOD, radius, gradient)
    network = network_of([[0, 0, 0], [7, 0, 0]], [(0, 1)], radius)
    solution = solve_flow(network, FlowConditions(VISCOSITY, inlet_flow_ul_s=flow, fluid=BLOOD))
    assert solution.pressure[0] == pytest.approx(7 * gradient, rel=1e-7)
    assert solution.wall_shear[0] == pytest.approx(gradient * radius / 2, rel=1e-7)


@pytest.mark.parametrize("index", [0.3, 0.7, 1.0, 1.6])
def test_a_power_law_fluid_follows_its_closed_form_in_a_taper(index: float) -> None:
    """−dp/ds = 2 K/r ((3n+1)/(nπ) Q/r³)ⁿ with r = a + cs, integrated by hand."""
    consistency, flow, a, b, length = 0.02, 5.0, 0.5, 0.25, 8.0
    network = VesselNetwork.from_segments(
        np.array([[0.0, 0, 0], [length, 0, 0]]),
        np.array([[0, 1]]),
        np.array([a]),
        np.zeros(1),
        np.zeros(1),
    )
    network.radius[1] = b
    fluid = PowerLaw(consistency, index)
    found = solve_flow(network, FlowConditions(VISCOSITY, inlet_flow_ul_s=flow, fluid=fluid))
    factor = 2 * consistency * ((3 * index + 1) / (index * np.pi) * flow) ** index
    whole = factor * (b ** (-3 * index) - a ** (-3 * index)) / (-3 * index) * length / (b - a)
    assert found.pressure[0] == pytest.approx(whole, rel=1e-12 if index == 1 else 1e-5)


def test_power_law_branches_divide_by_their_closed_form() -> None:
    """Q ~ r^(3 + 1/n) at the same drop and length."""
    n = 0.5
    network = network_of([[0, 0, 0], [5, 0, 0]], [(0, 1), (0, 1)], [0.4, 0.2])
    fluid = PowerLaw(0.05, n)
    found = solve_flow(network, FlowConditions(VISCOSITY, inlet_flow_ul_s=3.0, fluid=fluid))
    assert found.flow[0] / found.flow[1] == pytest.approx(2 ** (3 + 1 / n), rel=1e-9)
    assert found.flow.sum() == pytest.approx(3.0, rel=1e-12)


@pytest.mark.parametrize("fluid", [BLOOD, PowerLaw(0.02, 0.4), PowerLaw(0.001, 1.7)])
def test_mass_and_energy_are_conserved_in_trees_of_any_fluid(fluid):
    network = random_tree(3, 60, 0.4)
    conditions = FlowConditions(VISCOSITY, inlet_flow_ul_s=20.0, fluid=fluid)
    told = flow_summary(network, solve_flow(network, conditions), conditions)
    assert told["mass_imbalance"] < 1e-12
    assert told["energy_imbalance"] < 1e-9


def test_blood_flows_thinner_where_vessels_are_narrow() -> None:
    """Pries et al. 1994 at 0.45: the in vivo law's own formula, typed once more."""
    radius = np.array([0.01, 0.05, 0.5])
    d = 2e3 * radius
    fluid = Pries1994(4e-3, 0.45)
    network = network_of([[0, 0, 0], [1, 0, 0]], [(0, 1)] * 3, radius.tolist())
    found = solve_flow(network, FlowConditions(VISCOSITY, inlet_pressure_pa=10.0, fluid=fluid))
    s = (d / (d - 1.1)) ** 2
    at_45 = 6 * np.exp(-0.085 * d) + 3.2 - 2.44 * np.exp(-0.06 * d**0.645)
    viscosity = 1.25e-3 * (1 + (at_45 - 1) * s) * s
    assert found.flow == pytest.approx(10 * np.pi * radius**4 / (8 * viscosity), rel=1e-12)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: PowerLaw(0.0, 0.5), "consistency"),
        (lambda: PowerLaw(1.0, 0.0), "index is 0"),
        (lambda: Carreau(0.001, 0.003), "swap them"),
        (lambda: Carreau(index=2.0), "0.1 to 1"),
        (lambda: Pries1994(4e-3, 0.9), "haematocrit"),
        (lambda: Newtonian(-1.0), "above 0"),
    ],
)
def test_impossible_fluids_are_refused(make: object, words: str) -> None:
    with pytest.raises(FlowError, match=words):
        make()  # type: ignore[operator]
