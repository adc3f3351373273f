"""A leak is a way open throughout; a row of closed voids is none; the scan's limit is told."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from kernels.arrays import FloatArray
from registration.measuring.gauging.resolution import edge_blur_mm, resolved_um
from registration.segmentation import GelField, Segmentation
from tests.registration.phantom import CHANNEL, VOXEL, WIDE, block
from tests.registration.test_defects import findings, hole

SIGMA_MM = 0.06
WAY = hole((5.0, 1.2, 1.3), (5.0, 3.2, 1.3), 0.10)
OUT = hole((4.5, 3.2, 1.3), (4.5, 3.2, 9.0), 0.10)


def blurred(extra: Callable[[FloatArray], FloatArray] | None) -> Segmentation:
    """The block in a scan of that blur, with sharp walls beneath it."""
    sharp = block(extra=extra)
    assert isinstance(sharp.field, GelField)
    share = np.clip(3 * (np.asarray(sharp.field.values, dtype=np.float64) - 0.5) * 2 + 0.5, 0, 1)
    values = gaussian_filter(share, SIGMA_MM / VOXEL).astype(np.float32)
    return replace(sharp, field=replace(sharp.field, values=values))


def voids(way: Callable[[FloatArray], FloatArray]) -> Callable[[FloatArray], FloatArray]:
    """Only 0.1 mm in 0.16 of a way, along y and z: gel lies between."""

    def closed(points: FloatArray) -> FloatArray:
        along = points[..., 1] + points[..., 2]
        gel = 0.05 - np.abs((along + 0.05) % 0.16 - 0.08)
        return np.maximum(way(points), -gel)

    return closed


@pytest.mark.parametrize(("way", "ends"), [(WAY, (CHANNEL, WIDE)), (OUT, (WIDE, None))])
def test_an_open_way_as_wide_as_the_scan_resolves_is_a_leak(way, ends) -> None:
    scan = blurred(way)
    assert resolved_um(SIGMA_MM) == pytest.approx(200, abs=1)
    ways = [d for d in findings(scan).defects if d.kind in ("leak", "bridge")]
    assert [(d.vessel, d.other, d.doubt) for d in ways] == [(*ends, "")]


@pytest.mark.parametrize("way", [WAY, OUT])
def test_a_row_of_closed_voids_is_no_leak_but_noted(way) -> None:
    found = findings(blurred(voids(way)))
    assert [d for d in found.defects if d.kind in ("leak", "bridge")] == []
    assert found.contrast.unresolved == 1


def test_the_limit_of_leaks_follows_from_how_sharp_the_scans_walls_are() -> None:
    scan = blurred(None)
    assert edge_blur_mm(scan) == pytest.approx(SIGMA_MM, abs=0.012)  # voxels add to it
    assert findings(scan).contrast.leak_um == pytest.approx(200, abs=40)
