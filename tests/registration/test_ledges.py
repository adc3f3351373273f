"""Correction of section walls for bright reflections, by their roughness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from registration.gauging import VesselTrace
from registration.gauging.sections import RAYS, independent_rays
from registration.gauging.wall_reflections import ROUGH, share_of_ledges, with_ledges
from registration.segmentation import Segmentation
from registration.uncertainty import ScanErrors
from tests.registration.phantom import as_designed, block, traces

BLUR, CONTRAST, DEPTH = 0.04, 8.0, 0.025
SPECKLE = float(np.sqrt(np.pi)) * BLUR / CONTRAST


def scattering(trace: VesselTrace, scatter: float) -> VesselTrace:
    """A trace whose rays scatter by `scatter` (mm) over as many places as the blur leaves."""
    n = len(trace.along)
    rays = np.full((n, RAYS), 0.3)
    noise = 2 * scatter / np.sqrt(independent_rays(np.full(n, 0.3), BLUR))
    return replace(trace, sections=replace(trace.sections, rays=rays, noise=noise))


def case() -> tuple[tuple[VesselTrace, ...], Segmentation]:
    found = block(as_designed)
    return traces(found), found


@pytest.mark.parametrize(
    ("scatter", "part"),
    [
        (SPECKLE, 0.0),
        (float(np.hypot(SPECKLE, 0.5 * ROUGH * DEPTH)), 0.25),
        (float(np.hypot(SPECKLE, 2 * ROUGH * DEPTH)), 1.0),
    ],
)
def test_ledges_are_what_walls_scatter_beyond_speckle(scatter: float, part: float):
    rough = tuple(scattering(trace, scatter) for trace in case()[0])
    assert share_of_ledges(rough, BLUR, CONTRAST, DEPTH) == pytest.approx(part, abs=1e-6)


def test_without_sections_walls_may_have_ledges_all_over():
    assert share_of_ledges((), BLUR, CONTRAST, DEPTH) == 1.0


def test_smooth_walls_give_back_what_ledges_would_have_sent_and_get_what_the_cap_took():
    found, segmentation = case()
    smooth = tuple(scattering(trace, 0.0) for trace in found)
    field = replace(segmentation.field, faint_mm=0.006, cut_mm=0.004)
    errors = replace(ScanErrors.of_blur(BLUR), faint_mm=0.003)
    moved, left, wall = with_ledges(smooth, replace(segmentation, field=field), errors)
    assert wall == pytest.approx(field.wall_mm + 0.004 - 0.006)
    assert left.faint_mm == 0.0
    for before, after in zip(smooth, moved, strict=True):
        known = before.sections.diameter > 0
        change = after.sections.diameter[known] - before.sections.diameter[known]
        np.testing.assert_allclose(change, 2 * (0.004 - 0.006))
        np.testing.assert_array_equal(
            after.sections.diameter[~known], before.sections.diameter[~known]
        )


def test_micro_ct_has_no_reflections():
    found, segmentation = case()
    errors = ScanErrors.of_blur(BLUR)
    assert with_ledges(found, segmentation, errors) == (found, errors, segmentation.field.wall_mm)
