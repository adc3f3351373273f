"""Planted print defects: position and size, counted in voxels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.devices.scanner import Defect, with_defects
from sim.errors import ScannerError
from sim.gcode.deposit.lay import Deposit

EDGE = 0.025
RADIUS = 0.3
AXIS = np.array([[0.0, 1.0, 1.0], [6.0, 1.0, 1.0]])


def bored() -> Deposit:
    """A bar of gel, 6 × 2 × 2 mm, with a lumen along x."""
    z, y, _ = np.meshgrid(*(EDGE * np.arange(n) for n in (81, 81, 241)), indexing="ij")
    away = np.hypot(y - 1.0, z - 1.0) - RADIUS
    volume = np.round(255 * np.clip(0.5 + away / EDGE, 0, 1)).astype(np.uint8)
    return Deposit(volume, np.zeros(3), EDGE, "layered", 1.0, 0.0)


def free_area(deposit: Deposit, x: float) -> float:
    """Of the lumen across x, mm²."""
    plane = deposit.volume[:, :, round(x / EDGE)]
    return float((1 - plane / 255.0).sum() * EDGE**2)


def diameter(deposit: Deposit, x: float) -> float:
    return float(np.sqrt(4 / np.pi * free_area(deposit, x)))


def test_bulge_stands_back_by_its_height_and_fades_out() -> None:
    found = with_defects(bored(), [Defect("bulge", AXIS, RADIUS, 3.0, 1.2, 0.06)])
    assert diameter(found, 3.0) == pytest.approx(2 * (RADIUS + 0.06), abs=0.003)
    sigma = 1.2 / 4
    assert diameter(found, 3.0 + sigma) == pytest.approx(
        2 * (RADIUS + 0.06 * np.exp(-0.5)), abs=0.003
    )
    assert diameter(found, 5.0) == pytest.approx(2 * RADIUS, abs=0.002)


def test_stenosis_leaves_its_share_of_the_diameter() -> None:
    found = with_defects(bored(), [Defect("stenosis", AXIS, RADIUS, 3.0, 1.6, left=0.5)])
    assert diameter(found, 3.0) == pytest.approx(RADIUS, abs=0.003)
    assert diameter(found, 5.0) == pytest.approx(2 * RADIUS, abs=0.003)


def test_occlusion_is_as_long_as_ordered_and_beside_it_nothing_changes() -> None:
    found = with_defects(bored(), [Defect("occlusion", AXIS, 1.2 * RADIUS, 3.0, 0.8)])
    along = 1 - found.volume[round(1 / EDGE), round(1 / EDGE)] / 255.0
    assert (1 - along).sum() * EDGE == pytest.approx(0.8, abs=1e-3)
    np.testing.assert_array_equal(found.volume[..., :90], bored().volume[..., :90])


def test_missing_vessel_is_gel_throughout() -> None:
    found = with_defects(bored(), [Defect("missing", AXIS, 1.2 * RADIUS)])
    assert found.volume[:, :, 1:-1].min() == 255


def test_leak_is_a_round_hole_from_the_lumen_outward() -> None:
    way = np.array([[2.0, 1.0, 1.0], [2.0, 1.0, 2.5]])
    found = with_defects(bored(), [Defect("leak", way, 0.12)])
    plane = 1 - found.volume[round(1.7 / EDGE)] / 255.0
    assert plane.sum() * EDGE**2 == pytest.approx(np.pi * 0.12**2, rel=0.02)
    below = 1 - found.volume[round(0.4 / EDGE)] / 255.0
    assert below.sum() == 0


def test_in_sacrificial_ink_gel_and_lumen_change_places() -> None:
    gel = bored()
    ink = replace(gel, volume=255 - gel.volume, style="embedded")
    defects = [
        Defect("occlusion", AXIS, 1.2 * RADIUS, 3.0, 0.8),
        Defect("bulge", AXIS, RADIUS, 1.2, 0.8, 0.05),
    ]
    in_gel, in_ink = with_defects(gel, defects), with_defects(ink, defects)
    np.testing.assert_array_equal(in_ink.volume, 255 - in_gel.volume)


@pytest.mark.parametrize(
    ("defect", "reason"),
    [
        (lambda: Defect("bulge", AXIS, RADIUS, 3.0), "length_mm"),
        (lambda: Defect("missing", AXIS[:1], RADIUS), "two or more"),
        (lambda: Defect("missing", AXIS, 0.0), "radius_mm"),
        (lambda: Defect("stenosis", AXIS, RADIUS, 3.0, 1.0, left=1.0), "left"),
        (lambda: with_defects(bored(), [Defect("missing", AXIS + 50, 0.3)]), "outside"),
    ],
)
def test_impossible_defects_are_refused(defect, reason: str) -> None:
    with pytest.raises(ScannerError, match=reason):
        defect()
