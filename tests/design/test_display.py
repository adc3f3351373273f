"""Conversion to display units and back."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from design.display import LAB, Units
from design.errors import DesignError


@pytest.mark.parametrize(
    ("quantity", "unit", "ours", "shown"),
    [
        ("length", "µm", 0.4, 400),
        ("length", "um", 0.4, 400),
        ("length", "cm", 25, 2.5),
        ("pressure", "kPa", 13332.2, 13.3322),
        ("pressure", "mmHg", 13332.2, 100),
        ("pressure", "mbar", 100, 1),
        ("flow", "mL/min", 1000, 60),
        ("flow", "uL/min", 2, 120),
        ("shear", "dyn/cm2", 1.5, 15),
    ],
)
def test_a_value_is_shown_in_the_unit_asked_for(quantity, unit, ours, shown):
    units = Units(**{quantity: unit})
    assert units.of(quantity, ours) == pytest.approx(shown)


@given(
    value=st.floats(-1e6, 1e6),
    quantity=st.sampled_from(["length", "pressure", "flow", "shear"]),
    units=st.sampled_from([LAB, Units(), Units("cm", "kPa", "uL/min", "dyn/cm²")]),
)
def test_what_is_shown_is_taken_back(value, quantity, units):
    assert units.back(quantity, units.of(quantity, value)) == pytest.approx(value)


def test_a_unit_that_is_not_known_is_refused_with_those_that_are():
    with pytest.raises(DesignError, match=r"pressure can't be shown in 'psi'.*mmHg"):
        Units(pressure="psi")
