"""1D flow benchmark cases of Boileau et al. 2015, those whose inputs are known.

The paper's own waves aren't at hand as numbers. What is asserted is what its set-ups say of
themselves (the beds are tuned so that diastole is at the pressure that the wall is given at), what
linear theory says of the single pulse, and that a finer grid changes nothing.
"""

from __future__ import annotations

import numpy as np
import pytest

from design.hemodynamics import (
    OneDOptions,
    OneDSolution,
    PressureOutlet,
    PulsatileConditions,
    ThinWall,
    solve_one_d,
)
from design.hemodynamics.waveforms import Constant
from tests.design.hemodynamics.networks import network_of
from tests.design.hemodynamics.one_d import cases
from tests.design.hemodynamics.one_d.tubes import march, posed, pressures, with_scale
from tests.slower import first_of


@pytest.mark.parametrize("viscosity", first_of([4e-3, 1e-12]))
def test_a_single_pulse_in_a_long_vessel(viscosity: float) -> None:
    """10 m, radius 10 mm, wall 1.5 mm of 400 kPa, ϱ 1050, ζ = 9, Q = exp(-10⁴ (t - 0.05)²) mL/s."""
    density, area = 1.05e-3, np.pi * 100.0
    speed = np.sqrt(4e5 * 1.5 / 0.75 / 10.0 / 2.0 / density)
    assert speed == pytest.approx(6170.0, rel=1e-3)
    network = network_of([[0, 0, 0], [10_000, 0, 0]], [(0, 1)], 10.0)
    conditions = PulsatileConditions(
        viscosity, Constant(0.0), wall=ThinWall(4e5, 1.5), density=density,
        outlet=PressureOutlet(Constant(0.0)),
    )  # fmt: skip
    options = OneDOptions(cell_mm=2.5, profile_exponent=9.0, reflection={1: 0.0})
    problem = posed(network, conditions, options)
    grid = with_scale(problem.grid, 20.0, 1000.0)
    until = 0.05 + 4000.0 / speed
    march(grid, problem.nodes, problem.state, until, 2000,
          lambda t: 1e3 * np.exp(-1e4 * (t - 0.05) ** 2))  # fmt: skip
    p = pressures(grid, problem.state)
    sent = density * speed / area * 1e3
    died = np.exp(-22.0 * np.pi * viscosity / density * 4000.0 / (2.0 * area * speed))
    assert p.max() == pytest.approx(sent * died, rel=0.015)
    x = (np.arange(4000) + 0.5) * 2.5
    assert x[np.argmax(p)] == pytest.approx(4000.0, abs=15.0)


def solved(name: str, exponent: float) -> tuple[OneDSolution, OneDSolution, PulsatileConditions]:
    network, conditions = getattr(cases, name)()
    coarse, fine = (
        solve_one_d(network, conditions, OneDOptions(profile_exponent=exponent, cells_per_period=n))
        for n in (400, 1600)
    )
    return coarse, fine, conditions


@pytest.mark.parametrize(
    ("name", "exponent", "diastole", "pulse"),
    # Pulse pressure and flow range in the middle of the first vessel: ours, noted to be kept.
    [
        ("carotid", 2.0, 10.9e3, (5.63e3, 8.18e3)),
        ("aorta", 9.0, 9.5e3, (6.71e3, 513e3)),
        ("bifurcation", 9.0, 9.5e3, (7.55e3, 94.3e3)),
    ],
)
def test_arteries(name: str, exponent: float, diastole: float, pulse: tuple[float, float]) -> None:
    coarse, fine, conditions = solved(name, exponent)
    for what in ("pressure_in", "pressure", "pressure_out"):
        ours, finer = getattr(coarse, what), getattr(fine, what)
        np.testing.assert_allclose(ours, finer, atol=0.01 * np.ptp(finer))
    assert fine.pressure_out.min() == pytest.approx(diastole, rel=0.03)
    outlet = conditions.outlet
    assert isinstance(outlet, type(cases.windkessel(1.0, 1.0, 1.0)))
    mean = fine.flow_out.mean(axis=1) * (outlet.proximal + outlet.distal)
    leaves = slice(1, None) if len(mean) > 1 else slice(None)
    assert fine.pressure_out.mean(axis=1)[leaves] == pytest.approx(mean[leaves], rel=2e-3)
    assert np.ptp(fine.pressure[0]) == pytest.approx(pulse[0], rel=0.01)
    assert np.ptp(fine.flow[0]) == pytest.approx(pulse[1], rel=0.01)
    assert fine.mass_imbalance < 1e-9
