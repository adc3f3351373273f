import math
from typing import Any

import pytest

from registration.report.wording import decimals_for, duration, fixed, label_and_unit, number, plain


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"), (math.nan, "–"), (math.inf, "–"), (True, "–"), (0, "0"), (0.0, "0"),
        (-3, "\u22123"), (123456, "123\u202f456"), (12.3456, "12.35"), (0.00123456, "0.001235"),
        (-0.5, "\u22120.5"), (1234567.0, "1\u202f234\u202f567"), (2.5e-7, "2.500·10⁻⁷"),
        (1e12, "1.000·10¹²"),
    ],
)  # fmt: skip
def test_numbers(value: Any, text: str) -> None:
    assert number(value) == text


def test_a_rounded_zero_has_no_sign() -> None:
    assert fixed(-0.001, 1) == "0.0"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(1.416, "1.42 s"), (200, "3 min 20 s"), (4382.1, "1 h 13 min"), (None, "–")],
)
def test_durations(seconds: Any, text: str) -> None:
    assert duration(seconds) == text


@pytest.mark.parametrize(
    ("key", "expected"),
    [
        ("inlet_flow_ml_min", ("Inlet flow", "mL/min")),
        ("diameter_min_mm", ("Diameter min.", "mm")),
        ("wall_shear_max_pa", ("Wall shear max.", "Pa")),
        ("p95_um", ("95th percentile", "µm")),
        ("duration_s", ("Duration", "s")),
        ("volume_mm3", ("Volume", "mm³")),
        ("layers", ("Layers", "")),
        ("resistance_pa_s_ul", ("Resistance", "Pa·s/µL")),
        ("vessels_per_mm2", ("Vessels", "1/mm²")),
        ("within_200_um_of_a_lumen_percent", ("Within 200 µm of a lumen", "%")),
    ],
)
def test_labels_and_units_come_from_the_key(key: str, expected: tuple[str, str]) -> None:
    assert label_and_unit(key) == expected


def test_a_column_has_the_decimals_of_its_largest_number() -> None:
    assert decimals_for([0.001, 12.3, None]) == 1
    assert decimals_for([1, 2000]) == 0
    assert decimals_for([]) == 0


def test_plain_text_of_json_values() -> None:
    assert plain([1, 2.5, None]) == "1, 2.5, –"
    assert plain({"a": True}) == "a: yes"
    assert plain("") == "–"
