"""Refusal of vessels thinner than the needle writes: what it names, and what would help."""

from __future__ import annotations

import numpy as np
import pytest

from design.errors import ToolpathError
from design.network import VesselNetwork
from design.toolpath.embedded import EmbeddedOptions, check_thinnest

SHIPPED = {"30g": 0.16, "33g": 0.108, "34g": 0.08}
OPTIONS = EmbeddedOptions(needle_inner_mm=0.16, needle_outer_mm=0.31, thinnest=0.8)


def side_by_side(*radii: float) -> VesselNetwork:
    n = len(radii)
    x = np.arange(n, dtype=float)
    ends = [[k, y, 0.0] for k in x.tolist() for y in (0.0, 5.0)]
    zero = np.zeros(n, np.int64)
    return VesselNetwork.from_segments(
        np.array(ends), np.arange(2 * n).reshape(-1, 2), np.array(radii), zero, zero
    )


def refusal(network: VesselNetwork) -> str:
    with pytest.raises(ToolpathError) as told:
        check_thinnest(network, OPTIONS, needles=SHIPPED)
    return str(told.value)


def test_the_thinnest_vessel_is_named_with_its_place_and_a_needle_that_may_be_had() -> None:
    text = refusal(side_by_side(0.2, 0.05, 0.06))
    assert text.startswith("vessel 1: diameter 0.100 mm at (1, 0, 0) mm is thinner than 0.128 mm")
    assert "at most 0.125 mm bore (33g: 0.108 mm)" in text
    assert "1.28 times as large" in text


def test_of_hundreds_the_thinnest_five_are_named() -> None:
    """704 vessels made a line of 11,000 characters (a published network, 2026-11-26)."""
    text = refusal(side_by_side(*np.linspace(0.06, 0.05, 300)))
    assert "300 such vessels: 299 (0.100 mm), 298" in text
    assert "and 295 more" in text
    assert len(text) < 600
