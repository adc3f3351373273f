import math
from typing import Any

import pytest

from registration.report.wording import label_and_unit, number


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
