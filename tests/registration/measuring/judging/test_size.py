"""The print's size and its deviation without scales, against their limits."""

from __future__ import annotations

from typing import Any

import pytest

from printctl.pipeline.judging.verdict import verdict
from registration.measuring.judging import Tolerances, judge
from tests.registration.measuring.judging.registered import registration, vessel

GOOD = vessel(0, [0.0] * 20, u_um=8.0)


def sized(scale: list[float], half: list[float | None], **more: Any) -> dict[str, Any]:
    return registration(
        GOOD, scale=scale, interval_95={"scale": half}, size_mm=[16.0, 10.0, 5.0],
        lay={"depth_axis": "z"}, measured_by={"voxel_um": [20, 20, 12], "modality": "oct"}, **more,
    )  # fmt: skip


def decisions(numbers: dict[str, Any], tolerances: Tolerances | None = None) -> dict[str, str]:
    features = judge(numbers, tolerances or Tolerances())["judging"]["features"]
    return {f["of"]: f["decision"] for f in features if f["name"] == "size"}


@pytest.mark.parametrize(
    ("scale", "half", "decided"),
    [
        (0.990, 0.003, "pass"),
        (0.960, 0.003, "fail"),
        (0.981, 0.003, "undecided"),
        (1.025, 0.003, "fail"),
    ],
)
def test_each_axis_may_be_2_percent_longer_or_shorter(scale, half, decided) -> None:
    found = decisions(sized([scale, 0.99, 0.99], [half, 0.001, 0.001]))
    assert found == {"x": decided, "y": "pass", "z": "pass"}


def test_a_short_axis_may_be_off_by_what_the_surface_may() -> None:
    """Of 5 mm 100 µm are 2 %; of 1 mm they are a tenth."""
    numbers = sized([0.99, 0.99, 0.95], [0.001] * 3) | {"size_mm": [16.0, 10.0, 1.0]}
    assert decisions(numbers)["z"] == "pass"
    assert decisions(numbers, Tolerances(rms_um=20.0))["z"] == "fail"


def test_an_axis_that_was_too_short_to_fit_has_no_size() -> None:
    assert set(decisions(sized([1.0, 1.0, 1.0], [0.003, 0.003, None]))) == {"x", "y"}


@pytest.mark.parametrize(
    ("scale", "half", "decided"),
    [
        (0.99, 0.023, "pass"),
        (0.975, 0.023, "undecided"),
        (0.93, 0.023, "fail"),
    ],
)
def test_depth_that_rests_on_an_index_passes_by_its_value_and_says_so(scale, half, decided) -> None:
    numbers = sized([0.99, 0.99, scale], [0.001, 0.001, half], depth_from_index=True)
    judged = judge(numbers, Tolerances())
    (found,) = [f for f in judged["judging"]["features"] if f.get("of") == "z"]
    assert found["decision"] == decided
    said = "; ".join(verdict(judged)["reasons"])
    assert ("depth rests on the refractive index" in said) == (decided == "pass")


def test_a_size_too_close_to_its_limit_says_what_narrows_its_interval() -> None:
    budget = [{"quantity": "scale_y", "reduce": "smaller voxels"}]
    judged = judge(sized([0.99, 0.981, 0.99], [0.003] * 3, budget=budget), Tolerances())
    (reason,) = [one for one in verdict(judged)["reasons"] if "Size along y" in one]
    assert reason.endswith("to decide; for a narrower interval, smaller voxels")


def test_the_rigid_fit_is_judged_as_the_scaled_one_unless_its_limit_is_given() -> None:
    numbers = sized([0.99] * 3, [0.001] * 3, rms_interval_95_um=5.0) | {"rigid": {"rms_um": 137.0}}

    def rigid(tolerances: Tolerances) -> str:
        features = judge(numbers, tolerances)["judging"]["features"]
        return next(str(f["decision"]) for f in features if f["name"] == "rigid")

    assert rigid(Tolerances()) == "fail"
    assert rigid(Tolerances(rigid_rms_um=200.0)) == "pass"


@pytest.mark.parametrize(
    ("scale", "state", "words"),
    [
        ([0.99] * 3, "passed", "Fitted size, of the design's: x 99.0 ± 0.1 %"),
        ([0.96] * 3, "failed", "Shrinkage or swelling, or a wrong voxel size: fitted size"),
        ([1.24] * 3, "undecided", "Wrong voxel size, or the scan of another part: fitted size"),
    ],
)
def test_the_fitted_size_is_always_said_and_first_where_it_is_off(scale, state, words) -> None:
    found = verdict(judge(sized(scale, [0.001] * 3), Tolerances()))
    assert found["passed"] == (state == "passed")
    assert found["undecided"] == (state == "undecided")
    where = -1 if state == "passed" else 0
    assert found["reasons"][where].startswith(words)


def test_a_scan_that_is_too_coarse_or_too_dark_says_so_first() -> None:
    coarse = sized([0.99] * 3, [0.001] * 3, needed_voxel_um=38.4)
    found = verdict(judge(coarse, Tolerances()))
    assert found["undecided"]
    assert "voxels of at most 38 µm (this scan: 20 × 20 × 12 µm)" in found["reasons"][0]
    dark = sized([0.99] * 3, [0.001] * 3, agreement={"lit_share": 0.2, "other_part": False})
    dark["vessels"] = [{**GOOD, "open": None}]
    found = verdict(judge(dark, Tolerances()))
    assert found["undecided"]
    assert "in 80 % of the designed lumens' volume" in found["reasons"][0]


def test_another_part_is_never_claimed_of_a_scan_that_shows_too_little() -> None:
    agreement = {"other_part": True, "foreign_share": 0.6, "designed_open": 0.3, "close_share": 0.1}
    coarse = sized([1.27] * 3, [0.001] * 3, needed_voxel_um=170.0, agreement=agreement)
    found = verdict(judge(coarse, Tolerances()))
    assert found["undecided"]
    assert found["reasons"][0].startswith("The scan is too coarse")
    dark = sized([1.22] * 3, [None] * 3, agreement={"other_part": False, "surface_lit": 0.43})
    found = verdict(judge(dark, Tolerances()))
    assert found["undecided"]
    assert "light reached 43 % of the scanned surface (limit 50 %)" in found["reasons"][0]
