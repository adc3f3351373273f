"""Remedies named where a template's terminals don't fit."""

from __future__ import annotations

from design.errors import LEAST_TERMINALS, CrowdedError


def test_fewer_terminals_are_asked_for_only_where_a_template_takes_so_few() -> None:
    """A heart of 33 mm was told to ask for 13, and then that 13 are too few (2026-11-26)."""
    assert "ask for 30 or fewer" in str(CrowdedError(30, 80))
    few = str(CrowdedError(13, 80))
    assert "or fewer" not in few
    assert f"{LEAST_TERMINALS} at least" in few


def test_a_smallest_diameter_is_named_as_it_leaves_no_pressure_drop_to_choose() -> None:
    assert "a smaller smallest_diameter_mm or, where that isn't given" in str(CrowdedError(30, 80))
