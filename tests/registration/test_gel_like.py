"""Lumens that something brightens without a wall of its own: neither open nor closed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from kernels.arrays import FloatArray
from registration.measuring.gauging import VesselTrace, without_gel_like
from registration.segmentation import Segmentation, gel_evidence
from tests.registration.phantom import CHANNEL, IDENTITY, VOXEL, WIDE, block, ladder, traces

MIDDLE = np.array([4.0, 1.2, 1.3])
"""On the channel's axis, 2.3 mm from its first node; the channel is 0.5 mm wide."""


def with_film(
    share: float, slope: float = 0.0, half: bool = False, at: float = MIDDLE[0]
) -> Segmentation:
    """The block with a sheet of that share of gel's brightness across the channel."""

    def sheet(x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
        return np.exp(-0.5 * ((x - at - slope * y) / 0.04) ** 2) * ((z > 0) | (not half))

    return holding(lambda *place: share * sheet(*place))


def holding(content: Callable[..., FloatArray]) -> Segmentation:
    """The block with something in its channel: share of gel by x, and y, z from the axis, mm."""
    scan = block(noise=0.004)
    shape = scan.field.values.shape
    z, y, x = (
        o + VOXEL * np.arange(n) for o, n in zip(scan.field.origin_mm[::-1], shape, strict=True)
    )
    y, z = y[None, :, None] - MIDDLE[1], z[:, None, None] - MIDDLE[2]
    inside = np.hypot(y, z) < 0.3
    values = np.maximum(scan.field.values, content(x, y, z) * inside).astype(np.float32)
    return replace(scan, field=replace(scan.field, values=values))


def found(scan: Segmentation) -> tuple[VesselTrace, ...]:
    return without_gel_like(ladder(), traces(scan), gel_evidence(scan.field, None), IDENTITY)


@pytest.mark.parametrize("slope", [0.0, 0.7])
def test_a_film_below_the_level_is_neither_open_nor_closed(slope: float) -> None:
    trace = found(with_film(0.4, slope))[CHANNEL]
    assert trace.sections.open.all()
    assert trace.along[trace.gel_like] == pytest.approx(2.3, abs=0.15)
    assert trace.gel_like.any()
    assert not (trace.seen | trace.counted)[trace.gel_like].any()


def test_sound_lumens_and_a_half_covered_one_are_open() -> None:
    assert not any(trace.gel_like.any() for trace in found(block(noise=0.004)))
    assert not found(with_film(0.4, half=True))[CHANNEL].gel_like.any()
    assert not found(with_film(0.4))[WIDE].gel_like.any()


def test_what_closes_sections_stays_an_occlusion() -> None:
    trace = found(with_film(0.9, at=4.05))[CHANNEL]
    assert not trace.sections.open.all()
    assert not trace.gel_like.any()


@pytest.mark.parametrize("share", [0.3, 0.4])
def test_weak_gel_over_a_stretch_is_found_over_all_of_it(share: float) -> None:
    trace = found(holding(lambda x, y, z: share * ((x > 3) & (x < 4.5)) + 0 * (y + z)))[CHANNEL]
    marked = trace.along[trace.gel_like] + 1.7
    assert marked[[0, -1]] == pytest.approx([3, 4.5], abs=0.12)
    assert trace.gel_like.sum() == pytest.approx(15, abs=2)


def test_sediment_in_half_of_a_lumen_is_found() -> None:
    trace = found(holding(lambda x, y, z: 0.4 * ((z < 0) & (x > 3) & (x < 6)) + 0 * y))[CHANNEL]
    marked = trace.along[trace.gel_like] + 1.7
    assert marked[[0, -1]] == pytest.approx([3, 6], abs=0.25)


def test_cells_that_thicken_along_a_lumen_leave_it_open() -> None:
    clouded = holding(lambda x, y, z: 0.02 + 0.018 * (x - 1.7) + 0 * (y + z))
    assert not any(trace.gel_like.any() for trace in found(clouded))


def at_the_mouth(content: Callable[[FloatArray], FloatArray]) -> VesselTrace:
    """The inlet, whose mouth is at x = 0, with something by x there."""
    scan = block(noise=0.004)
    x = scan.field.origin_mm[0] + VOXEL * np.arange(scan.field.values.shape[2])
    values = np.maximum(scan.field.values, content(x)).astype(np.float32)
    return found(replace(scan, field=replace(scan.field, values=values)))[0]


def test_a_film_across_the_mouth_is_found() -> None:
    trace = at_the_mouth(lambda x: 0.4 * np.exp(-0.5 * ((x - 0.05) / 0.04) ** 2))
    assert np.flatnonzero(trace.gel_like).tolist() == [0]


def test_a_film_at_the_very_end_is_found() -> None:
    trace = found(with_film(0.4, at=1.75))[CHANNEL]
    assert trace.gel_like[0]


def test_weak_gel_all_along_is_found_by_the_other_lumens() -> None:
    trace = found(holding(lambda x, y, z: 0.4 + 0 * (x + y + z)))[CHANNEL]
    assert trace.gel_like.mean() > 0.9


def test_faint_debris_in_the_lower_half_all_along_is_found() -> None:
    trace = found(holding(lambda x, y, z: 0.18 * (z < 0) + 0 * (x + y)))[CHANNEL]
    assert trace.own.mean() > 0.8
    assert trace.gel_like[trace.own].all()


def test_light_that_gel_above_scatters_on_is_no_debris() -> None:
    """It fades downwards, over 0.4 mm as in scans."""
    lit = holding(lambda x, y, z: 0.1 * np.exp(-(0.25 - z) / 0.4) + 0 * (x + y))
    assert not any(trace.gel_like.any() for trace in found(lit))


def test_a_parents_own_liquid_isnt_a_plug_of_its_branch() -> None:
    """The channel is brighter all along; the headers that meet it reach into its lumen."""
    traces_ = found(holding(lambda x, y, z: 0.16 + 0 * (x + y + z)))
    assert not any(trace.gel_like.any() for trace in traces_)


def test_a_narrowed_section_stays_a_stenosis() -> None:
    scan = block(lambda vessel, along: -0.11 * (vessel == CHANNEL) * (abs(along - 2.3) < 0.15))
    assert not found(scan)[CHANNEL].gel_like.any()


def test_a_bright_bath_isnt_a_film_across_the_mouth() -> None:
    assert not at_the_mouth(lambda x: 0.45 * np.clip(0.5 - x / 0.1, 0, 1)).gel_like.any()
