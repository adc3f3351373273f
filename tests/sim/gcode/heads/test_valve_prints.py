"""Pneumatic head's G-code, compared with the same part by plunger."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from design.toolpath import Toolpath
from design.toolpath.embedded import EmbeddedOptions
from design.toolpath.fresh import FreshOptions
from design.toolpath.gcode import GcodeOptions, write_gcode
from firmware_profiles import Printer, Syringe, load
from sim.gcode.deposit.lay import Deposit, deposit
from sim.gcode.deposit.pneumatic import pneumatic_deposit
from sim.gcode.dry_run.run import dry_run
from tests.design.toolpath.plans import embedded_toolpath, fresh_toolpath
from tests.design.toolpath.shapes import as_solid, block, random_tree, upright

AIR, PLUNGER = load(Printer, "pneumatic_marlin"), load(Printer, "generic_marlin")
SYRINGE = load(Syringe, "hamilton_1ml")
PLACE, START = (60.0, 70.0, 20.0), (60.0, 70.0, 60.0)
VOXEL = 0.05


@cache
def fresh_way():
    return fresh_toolpath(drilled_layer(), FreshOptions(joint_mm=0))  # as for a pneumatic head


@cache
def drilled_layer():
    return as_solid(block(4, 3, 0.3) - upright(2, 1.5, 1))


def by_plunger(toolpath: Toolpath) -> Deposit:
    data = write_gcode(toolpath, PLUNGER, SYRINGE, PLACE, GcodeOptions(start_mm=START)).data
    run = dry_run(data, PLUNGER, START)
    area = math.pi / 4 * SYRINGE.inner_mm**2
    return deposit(run.executed, area, VOXEL, plunger_step_mm=1 / PLUNGER.steps_per_mm.e)


def by_air(toolpath: Toolpath, flow: float) -> Deposit:
    options = GcodeOptions(start_mm=START, flow_ul_s=flow)
    data = write_gcode(toolpath, AIR, SYRINGE, PLACE, options).data
    return pneumatic_deposit(dry_run(data, AIR, START).executed, data, AIR, flow, VOXEL)


def filled(ink: Deposit, at: np.ndarray) -> np.ndarray:
    """Share of ink at points (n, 3); 0 outside the grid."""
    index = np.rint((at - ink.origin_mm) / VOXEL).astype(int)[:, ::-1]
    inside = ((index >= 0) & (index < ink.volume.shape)).all(axis=1)
    found = np.zeros(len(at))
    found[inside] = ink.volume[tuple(index[inside].T)] / 255
    return found


def grid(low: tuple[float, ...], high: tuple[float, ...]) -> np.ndarray:
    axes = [np.arange(a, b, VOXEL) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def test_a_fresh_lumen_stays_open_as_by_plunger() -> None:
    air, plunger = by_air(fresh_way(), 0.02), by_plunger(fresh_way())
    joined = by_plunger(fresh_toolpath(drilled_layer(), FreshOptions()))
    assert air.written_ul == pytest.approx(fresh_way().written_ul, rel=0.02)
    assert air.volume_mm3 == pytest.approx(plunger.volume_mm3, rel=0.02)
    at = grid((60.2, 70.2, 20.06), (63.8, 72.8, 20.25))
    away = np.hypot(at[:, 0] - 62, at[:, 1] - 71.5)
    assert filled(plunger, at[away < 0.42]).max() == 0
    for ink in (air, joined):
        assert filled(ink, at[away < 0.42]).max() == 0
        assert filled(ink, at[away > 0.58]).mean() > 0.97


def test_embedded_vessels_are_as_thick_as_by_plunger() -> None:
    toolpath = embedded_toolpath(random_tree(20, 8, 3, 0.15), EmbeddedOptions())
    air, plunger = by_air(toolpath, 0.3), by_plunger(toolpath)
    assert air.written_ul == pytest.approx(plunger.written_ul, rel=0.03)
    assert air.volume_mm3 == pytest.approx(plunger.volume_mm3, rel=0.04)
