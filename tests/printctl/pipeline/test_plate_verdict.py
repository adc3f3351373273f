"""Verdict on a plate, from the verdicts on its wells."""

from __future__ import annotations

from typing import Any

import pytest

from printctl.pipeline.plate.results import plate_verdict, well_figures


def well(passed: bool, undecided: bool) -> dict[str, Any]:
    verdict = {"passed": passed, "undecided": undecided, "reasons": ["Vessel 0: open"]}
    numbers = {"vessels": [{"error_percent": 1.0}], "scaled": {"rms_um": 9.0}}
    found = well_figures({"verdict": verdict, "registration": numbers})
    return {"well": "A1", "label": "one", **found}


GOOD, OPEN, BAD = well(True, False), well(False, True), well(False, False)


@pytest.mark.parametrize(
    ("wells", "passed", "undecided"),
    [
        ([GOOD, GOOD], True, False),
        ([GOOD, OPEN], False, True),
        ([OPEN, BAD], False, False),
        ([BAD, GOOD], False, False),
    ],
)
def test_one_undecided_well_leaves_the_plate_undecided(
    wells: list[dict[str, Any]], passed: bool, undecided: bool
) -> None:
    found = plate_verdict(wells, 3)
    assert (found["passed"], found["undecided"]) == (passed, undecided)
    assert found["reasons"][0].startswith(f"A1 (one) {wells[0]['outcome']}: Vessel 0")
    assert "1 of 3 wells weren't scanned" in found["reasons"][-1]
