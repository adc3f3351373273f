"""Diameter changes at the edges of a bridge."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from registration.measuring.gauging import Defect, VesselTrace, drop_edge_changes
from registration.measuring.gauging.defect import DefectKind

ALONG = (np.arange(40) + 0.5) * 0.1


def trace(vessel: int, x: float, way: int) -> VesselTrace:
    """Return an upright vessel, numbered upwards (1) or downwards (-1)."""
    centre = np.column_stack([np.full(40, x), np.zeros(40), ALONG[::way]])
    return cast(
        VesselTrace, SimpleNamespace(vessel=vessel, along=ALONG, centre=centre, spacing=0.1)
    )


def defect(kind: DefectKind, vessel: int, at: float, other: int | None = None) -> Defect:
    return Defect(
        kind=kind, vessel=vessel, other=other, from_mm=at - 0.1, to_mm=at + 0.1, at_mm=at,
        point_mm=(0.5, 0.0, at), size_um=200.0, error_um=20.0, percent=20.0, wall_um=20.0,
        significance=9.0, seen=True,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("vessel", "at", "kept"), [(0, 0.9, False), (0, 3.1, True), (1, 0.9, True), (1, 3.1, False)]
)
def test_a_bridge_takes_the_changes_at_its_own_end_in_each_vessel(
    vessel: int, at: float, kept: bool
) -> None:
    traces = trace(0, 0.0, 1), trace(1, 1.0, -1)
    bridge, change = defect("bridge", 0, 0.9, other=1), defect("bulge", vessel, at)
    assert drop_edge_changes([change], [bridge], traces) == ([change] if kept else [])
