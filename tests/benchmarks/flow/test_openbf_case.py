"""openBF's input files, read key by key."""

from copy import deepcopy
from typing import Any

import numpy as np
import pytest

from benchmarks.flow import openbf_case as openbf
from design.errors import FlowError
from design.hemodynamics import VesselWalls, WindkesselOutlet

DATA: dict[str, Any] = {
    "project_name": "fork",
    "write_results": ["P", "u"],
    "blood": {"rho": 1060.0, "mu": 4e-3},
    "solver": {"Ccfl": 0.9, "cycles": 10, "jump": 20, "convergence_tolerance": 1.0},
    "network": [
        {"label": "trunk", "sn": 1, "tn": 2, "L": 0.04, "E": 4e5, "Rp": 8e-3, "Rd": 6e-3, "M": 60,
         "gamma_profile": 9},
        {"label": "left", "sn": 2, "tn": 3, "L": 0.1015, "E": 5e5, "R0": 4e-3, "h0": 5e-4,
         "Pext": 1e3, "outlet": "wk3", "R1": 7e7, "R2": 3e9, "Cc": "4e-10", "Pout": 500.0},
        {"label": "right", "sn": 2, "tn": 7, "L": 0.002, "E": 5e5, "R0": 4e-3, "Rt": 0.3,
         "to_save": False},
    ],
}  # fmt: skip
INLET = np.array([[0.0, 1e-5], [0.3, 4e-5], [1.0, 1e-5]])


def changed(*path: Any, value: Any = None) -> dict[str, Any]:
    """The file with one value put in, or with ``None`` taken out."""
    data = deepcopy(DATA)
    place: Any = data
    for key in path[:-1]:
        place = place[key]
    if value is None:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return data


def test_a_file_is_read_in_our_units() -> None:
    case = openbf.case_of(DATA, INLET)
    assert case.network.lengths() == pytest.approx([40.0, 101.5, 2.0])
    assert np.diff(case.network.vessel_nodes, axis=1).ravel().tolist() == [1, 1, 2]
    cells = case.options.cell_mm
    assert cells is not None
    assert np.round(case.network.lengths() / cells).tolist() == [60, 102, 5]
    assert case.options.exponents(3).tolist() == [9.0, 2.0, 2.0]
    assert case.conditions.inlet.at(np.array([0.15, 1.0])) == pytest.approx([25e3, 10e3])
    walls = case.conditions.wall
    assert isinstance(walls, VesselWalls)
    assert walls.external_pa.tolist() == [0.0, 1e3, 0.0]
    r = 7e-3
    h = r * (0.2802 * np.exp(-505.3 * r) + 0.1324 * np.exp(-11.14 * r))
    stiff = walls.stiffness(np.array([0, 1]), np.array([7.0, 4.0]))
    assert stiff == pytest.approx([4 / 3 * 4e5 * h / r, 4 / 3 * 5e5 / 8])
    assert isinstance(case.conditions.outlet, dict)
    left = case.conditions.outlet[2]
    assert isinstance(left, WindkesselOutlet)
    found = (left.proximal, left.compliance, left.distal, left.distal_pa)
    assert found == pytest.approx((0.07, 0.4, 3.0, 500.0))
    assert case.options.reflection == {3: 0.3}
    assert (case.quantities, case.shown) == (("P", "u"), (0, 1))


def test_a_windkessel_of_two_elements_is_openbfs() -> None:
    """R₂ = R₁ - ϱ c/A at rest; R₁ stays."""
    data = changed("network", 1, "R2")
    data["network"][1] |= {"outlet": "wk2", "R1": 2e8}
    outlet = openbf.case_of(data, INLET).conditions.outlet
    assert isinstance(outlet, dict)
    area, stiff = np.pi * 4e-3**2, 4 / 3 * 5e5 / 8
    impedance = 1060 * np.sqrt(stiff / 2 / 1060) / area
    left = outlet[2]
    assert isinstance(left, WindkesselOutlet)
    assert left.proximal == pytest.approx(0.2)
    assert left.distal == pytest.approx((2e8 - impedance) * 1e-9)


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("colour",), "red", "'colour'"),
        (("_colour",), "red", "'_colour'"),
        (("network", 0, 5), 1, "network\\[0\\] has the key 5"),
        (("network", 0, "gamma profile"), 9, "'gamma_profile' and 'gamma profile'"),
        (("network", 0, "visco-elastic"), "yes", "visco-elastic is 'yes'"),
        (("network", 0, "initial_flow"), 1.0, "initial_flow"),
        (("network", 0, "Cc"), 1.0, "vessel trunk: Cc is for outlets"),
        (("network", 0, "R0"), 1.0, "R0 is given, and Rp"),
        (("network", 0, "E"), None, "vessel trunk: E is missing"),
        (("network", 0, "L"), "long", "L is 'long'"),
        (("network", 0, "sn"), 2, "sn"),
        (("network", 0, "gamma_profile"), 1, "gamma_profile is 1"),
        (("network", 1, "sn"), 9, "sn: one vessel begins"),
        (("network", 1, "label"), "trunk", "stands twice"),
        (("network", 1, "inlet_impedance_matching"), True, "inlet_impedance_matching"),
        (("network", 1, "Rt"), 0.1, "Rt doesn't go with"),
        (("network", 1, "outlet"), "wk2", "outlet is wk2 and has R2"),
        (("network", 1, "outlet"), "open", "outlet is 'open'"),
        (("network", 2, "Rt"), None, "vessel right ends in an outlet"),
        (("solver", "jump"), 3, "jump"),
        (("solver", "Ccfl"), 2.0, "Ccfl is 2"),
        (("write_results",), ["c"], "write_results: 'c'"),
        (("blood", "rho"), None, "rho is missing"),
    ],
)
def test_what_isnt_followed_is_refused_by_name(path, value, words):
    with pytest.raises(FlowError, match=words):
        openbf.case_of(changed(*path, value=value), INLET)


@pytest.mark.parametrize(
    ("inlet", "words"),
    [
        (INLET[:1], "two rows"),
        (INLET + [0.1, 0.0], "begins at 0.1 s"),
        (INLET * [1.0, 0.0] + [[0, 0], [0, 0], [0, 1.0]], "inlet_file: .*doesn't"),
    ],
)
def test_an_inlets_table_is_a_cycle(inlet: Any, words: str) -> None:
    with pytest.raises(FlowError, match=words):
        openbf.case_of(DATA, inlet)
