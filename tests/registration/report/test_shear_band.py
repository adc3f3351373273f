"""Wall shear range among the report's key figures."""

from __future__ import annotations

from registration.report.key_figures import key_figures

BAND = {
    "low_dyn_cm2": 5.0, "high_dyn_cm2": 30.0, "area_below": 0.25, "area_inside": 0.7,
    "area_above": 0.05, "verdict": "mixed",
}  # fmt: skip


def test_a_reader_sees_how_much_of_the_wall_lies_in_the_band() -> None:
    (figure,) = key_figures({"flow": {"shear_band": BAND}})
    assert figure.label == "Wall area at 5 to 30 dyn/cm²"
    assert (figure.value, figure.unit) == ("70", "%")
    assert figure.note == "25 % below, 5 % above: mixed"


def test_without_a_band_nothing_is_said() -> None:
    assert key_figures({"flow": {"wall_shear_min_pa": 1.0}}) == []
