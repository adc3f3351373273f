"""Decision rules by name, and the probability that a whole vessel conforms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from registration.measuring.judging import DecisionRule, Rule, Tolerances, VesselLimits, judge
from registration.measuring.judging.decisions import conformance
from tests.registration.measuring.judging.registered import registration, vessel


def judged(rule: DecisionRule, errors: np.ndarray, **more: Any) -> dict[str, Any]:
    limits = VesselLimits(rule=Rule(rule))
    found: dict[str, Any] = judge(registration(vessel(0, errors, **more)), Tolerances(limits))
    return found


@pytest.mark.parametrize(
    ("off_um", "guarded", "conforming", "shared"),
    [
        (0.0, "pass", "pass", "pass"),
        (28.0, "undecided", "pass", "pass"),
        (45.0, "undecided", "undecided", "pass"),
        (55.0, "undecided", "undecided", "fail"),
        (120.0, "fail", "fail", "fail"),
    ],
)
def test_each_rule_decides_by_its_own_risk(off_um, guarded, conforming, shared):
    """Of 500 ± 50 µm with U = 24.5 µm, nearly all of it shared by the vessel's sections."""
    decisions = [
        judged(rule, np.full(30, -off_um), u_um=24.5, noise_um=1.0)["vessels"][0]["decision"]
        for rule in DecisionRule
    ]
    assert decisions == [guarded, conforming, shared]


def test_what_isnt_known_is_undecided_by_every_rule() -> None:
    for rule in DecisionRule:
        row = vessel(0, np.zeros(20)) | {"interval_95_um": [None] + [10.0] * 19}
        limits = VesselLimits(rule=Rule(rule))
        found = judge(registration(row), Tolerances(limits))
        assert found["vessels"][0]["decision"] == "undecided"
        assert found["vessels"][0]["conformance"] is None


def test_a_shared_error_counts_once_and_noise_once_a_section() -> None:
    """Against draws of the same model; of noise alone the joint probability is a power."""
    n, rng = 50, np.random.default_rng(1)
    error = np.where(np.arange(n) % 2, 20.0, -5.0)  # differs by far more than noise
    common, random = np.full(n, 12.0), np.full(n, 3.0)
    below = above = np.full(n, 40.0)
    each, joint = conformance(error, common, random, below, above)
    true = error - 12.0 * rng.standard_normal((20_000, 1)) - 3.0 * rng.standard_normal((20_000, n))
    held = np.abs(true) <= 40.0
    assert joint == pytest.approx(held.all(axis=1).mean(), abs=0.015)
    assert each == pytest.approx(held.mean(axis=0), abs=0.015)
    # Proven alone, each would count the shared error anew.
    assert joint > each.prod() + 0.2
