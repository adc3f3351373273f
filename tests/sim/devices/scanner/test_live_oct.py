"""Simulated OCT of a field in place: a part of it is seen as in a scan of all of it."""

from __future__ import annotations

import numpy as np
import pytest

from sim.devices.recorded_ink import InkSource
from sim.devices.scanner.oct import OctField, live_scan
from sim.errors import ScannerError
from sim.gcode.deposit.lay import Laid
from sim.gcode.deposit.strands import Strands

LOW, HIGH = np.array([1.0, 0.5, 0.3]), np.array([2.5, 1.5, 0.9])


@pytest.fixture(scope="module")
def field() -> OctField:
    source = InkSource(printer="generic_marlin", syringe="hamilton_1ml", ink="collagen_fresh")
    return OctField(low_mm=(0, 0, 0), high_mm=(3, 2, 1.2), looks=64, laid=source)


def voxels(scan, places):
    """Brightness at places of the printer, mm."""
    at = places @ scan.pose_truth[:3, :3].T + scan.pose_truth[:3, 3]
    dz, dy, dx = scan.voxel_mm
    index = np.floor(at / [dx, dy, dz / scan.refractive_index]).astype(int)
    return scan.volume[index[:, 2], index[:, 1], index[:, 0]].astype(float)


@pytest.fixture(scope="module")
def ink() -> Laid:
    """Filaments of 0.3 mm across the field, in a bath."""
    y = np.array([0.4, 1.0, 1.6])
    start = np.stack([np.full(3, -1.0), y, np.full(3, 0.6)], axis=1)
    end = start + [5.0, 0, 0]
    dose = np.full(3, 5.0 * np.pi / 4 * 0.3**2)
    return Laid(Strands.dosed(start, end, dose, np.arange(3), np.arange(3) + 1), None)


def test_a_part_of_the_field_is_seen_as_in_a_scan_of_all_of_it(ink, field):
    all_of_it, part = (live_scan(ink, field, 5, one) for one in (None, (LOW, HIGH)))
    assert part.volume.size < 0.3 * all_of_it.volume.size
    rng = np.random.default_rng(1)
    places = rng.uniform(LOW + 0.05, HIGH - 0.05, (4000, 3))
    whole, seen = (voxels(one, places) for one in (all_of_it, part))
    inside = np.hypot(places[:, 1] - 1.0, places[:, 2] - 0.6) < 0.1
    assert whole[inside].mean() > 20 * whole[~inside & (places[:, 2] > 0.8)].mean()
    assert np.median(seen[inside] / whole[inside]) == pytest.approx(1.0, abs=0.05)
    assert np.corrcoef(np.log(whole + 1), np.log(seen + 1))[0, 1] > 0.95


def test_a_region_beside_the_field_is_refused(ink, field):
    with pytest.raises(ScannerError, match="lies outside the OCT's field"):
        live_scan(ink, field, 5, (LOW + 5, HIGH + 5))
