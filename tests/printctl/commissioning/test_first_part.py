"""First part of a commissioning; moves with at most one plunger step."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from design.network_files.csv_format import read_network_csv
from firmware_profiles import Needle, Printer, Syringe, load, profile_doubts, shipped
from gcode.deposit.written import Strands
from printctl.checks.preflight.steps import single_step_share
from printctl.commissioning.first_part import FirstPart


@pytest.mark.parametrize("needle", shipped(Needle))
def test_lumens_suit_the_needle_and_lie_within_the_block(needle: str, tmp_path: Path) -> None:
    part = FirstPart(load(Needle, needle).inner_mm)
    (tmp_path / "lumen.csv").write_text(part.network())
    network = read_network_csv(tmp_path / "lumen.csv", unit="mm")
    assert network.vessel_count == 3
    assert 2 * network.radius.min() >= 3 * part.bore_mm - 0.01
    wall = network.radius.max() + part.bore_mm
    inside = network.points[:, 1:]
    assert (inside >= wall).all()
    assert (inside <= np.array(part.size_mm[1:]) - wall).all()
    (dimples,) = part.fiducials()
    x, y, _ = dimples["at_mm"]
    assert x + dimples["size_mm"] + dimples["diameter_mm"] < part.size_mm[0]
    assert y > dimples["diameter_mm"] / 2


def test_the_share_counts_moves_that_get_a_whole_step_or_none() -> None:
    printer, syringe = load(Printer, "generic_marlin"), load(Syringe, "hamilton_1ml")
    step_ul = syringe.area_mm2 / printer.steps_per_mm.e
    ends = np.arange(4.0)[:, None] * [1.0, 0.0, 0.0]
    dose = step_ul * np.array([0.5, 1.0, 1.5, 8.0])
    wrote = Strands.dosed(ends, ends + [1.0, 0, 0], dose, np.zeros(4, int), np.arange(4))
    assert single_step_share(wrote, printer, syringe) == 0.5
    assert single_step_share(wrote, printer, load(Syringe, "hamilton_10ml")) == 1.0


def test_a_profile_with_coarse_steps_says_for_which_syringes_and_bores() -> None:
    syringes = [load(Syringe, name) for name in shipped(Syringe)]
    doubts = {one.key: one for one in profile_doubts(load(Printer, "generic_marlin"), syringes)}
    coarse = doubts["steps_per_mm.e"]
    assert not coarse.grave
    assert "Hamilton 5 mL gastight (bores below 0.25 mm)" in coarse.text
    assert "Hamilton 1 mL" not in coarse.text
