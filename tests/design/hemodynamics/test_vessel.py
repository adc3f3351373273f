"""Resistance, inertance and compliance of a vessel; Womersley flow."""

from __future__ import annotations

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import GelWall, ThinWall, question_pressure
from design.hemodynamics.vessel_coefficients import (
    impedance_factor,
    integral_of_power,
    shear_factor,
)
from design.network import VesselNetwork

TAPER = VesselNetwork(
    nodes=np.array([[0.0, 0, 0], [5, 0, 0]]),
    vessel_nodes=np.array([[0, 1]]),
    kind=np.array([4]),
    tree=np.array([0]),
    offset=np.array([0, 3]),
    points=np.array([[0.0, 0, 0], [2, 0, 0], [5, 0, 0]]),
    radius=np.array([0.6, 0.4, 0.2]),
)


def test_walls_give_way_as_in_the_books() -> None:
    r2, r3 = integral_of_power(TAPER, 2)[0], integral_of_power(TAPER, 3)[0]
    assert GelWall(10e3).compliance(TAPER)[0] == pytest.approx(3 * np.pi * r2 / 10e3)
    assert ThinWall(1e5, 0.1).compliance(TAPER)[0] == pytest.approx(3 * np.pi * r3 / (2 * 1e4))
    with pytest.raises(FlowError, match="Poisson's ratio lies between"):
        GelWall(1e4, poisson=0.7)


def _by_finite_volumes(alpha: float, rings: int = 1500) -> tuple[complex, complex]:
    """Pressure and wall shear per flow over Poiseuille's, from iα² u = G + ∇²u in unit radius."""
    edge = np.arange(rings + 1) / rings
    area = np.pi * np.diff(edge**2)
    across = 2 * np.pi * edge[1:-1] * rings
    wall = 2 * np.pi * 2 * rings
    diagonal = 1j * alpha**2 * area
    diagonal[:-1] += across
    diagonal[1:] += across
    diagonal[-1] += wall
    # Thomas' algorithm, G = 1.
    right = area.astype(complex)
    for k in range(1, rings):
        part = across[k - 1] / diagonal[k - 1]
        diagonal[k] -= part * across[k - 1]
        right[k] += part * right[k - 1]
    u = right
    u[-1] /= diagonal[-1]
    for k in range(rings - 2, -1, -1):
        u[k] = (right[k] + across[k] * u[k + 1]) / diagonal[k]
    flow = (u * area).sum()
    return np.pi / 8 / flow, (u[-1] * 2 * rings) / (4 * flow / np.pi)


@pytest.mark.parametrize("alpha", [0.1, 0.29, 0.31, 2.0, 12.0])
def test_oscillating_flow_solves_womersleys_equation(alpha: float) -> None:
    pressure, shear = _by_finite_volumes(alpha)
    assert impedance_factor(np.array([alpha]))[0] == pytest.approx(pressure, rel=2e-5)
    assert shear_factor(np.array([alpha]))[0] == pytest.approx(shear, rel=2e-5)


def test_a_million_millimetres_of_mercury_are_questioned() -> None:
    question_pressure(133.322 * 500)
    with pytest.raises(FlowError, match=r"1e\+06 mmHg.*another unit"):
        question_pressure(133.322e6)


@pytest.mark.parametrize("power", [2, 3, -2, -4])
def test_tapers_are_integrated(power: int) -> None:
    middle = (np.arange(50_000) + 0.5) / 50_000 * 5
    radius = np.interp(middle, [0, 2, 5], TAPER.radius)
    by_sum = (radius**power).mean() * 5
    assert integral_of_power(TAPER, power)[0] == pytest.approx(by_sum, rel=1e-7)


def test_the_series_and_the_functions_meet_and_large_numbers_dont_overflow() -> None:
    below, above = impedance_factor(np.array([0.3 - 1e-9, 0.3]))
    assert below == pytest.approx(above, rel=1e-8)
    assert np.isfinite(impedance_factor(np.array([0.0, 1e4]))).all()
