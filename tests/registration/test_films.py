"""What is thin and too blurred to close a section leaves a lumen neither open nor closed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from registration.gauging import VesselTrace, without_films
from registration.segmentation import Segmentation
from tests.registration.phantom import CHANNEL, IDENTITY, VOXEL, WIDE, block, traces

MIDDLE = np.array([4.0, 1.2, 1.3])
"""On the channel's axis, 2.3 mm from its first node; the channel is 0.5 mm wide."""


def with_film(
    share: float, slope: float = 0.0, half: bool = False, at: float = MIDDLE[0]
) -> Segmentation:
    """The block with a sheet of that share of gel's brightness across the channel."""
    scan = block(noise=0.004)
    shape = scan.field.values.shape
    z, y, x = (
        o + VOXEL * np.arange(n) for o, n in zip(scan.field.origin_mm[::-1], shape, strict=True)
    )
    y, z = y[None, :, None] - MIDDLE[1], z[:, None, None] - MIDDLE[2]
    sheet = share * np.exp(-0.5 * ((x - at - slope * y) / 0.04) ** 2) * (np.hypot(y, z) < 0.3)
    if half:
        sheet = sheet * (z > 0)
    values = np.maximum(scan.field.values, sheet).astype(np.float32)
    return replace(scan, field=replace(scan.field, values=values))


def found(scan: Segmentation) -> tuple[VesselTrace, ...]:
    return without_films(traces(scan), scan.field, IDENTITY)


@pytest.mark.parametrize("slope", [0.0, 0.7])
def test_a_film_below_the_level_is_neither_open_nor_closed(slope: float) -> None:
    trace = found(with_film(0.4, slope))[CHANNEL]
    assert trace.sections.open.all()
    assert trace.along[trace.crossed] == pytest.approx(2.3, abs=0.15)
    assert trace.crossed.any()
    assert not (trace.seen | trace.counted)[trace.crossed].any()


def test_a_film_at_the_very_end_is_found() -> None:
    trace = found(with_film(0.4, at=1.75))[CHANNEL]
    assert trace.crossed[0]


def test_sound_lumens_and_a_half_covered_one_are_open() -> None:
    assert not any(trace.crossed.any() for trace in found(block(noise=0.004)))
    assert not found(with_film(0.4, half=True))[CHANNEL].crossed.any()
    assert not found(with_film(0.4))[WIDE].crossed.any()


def test_what_closes_sections_stays_an_occlusion() -> None:
    trace = found(with_film(0.9, at=4.05))[CHANNEL]
    assert not trace.sections.open.all()
    assert not trace.crossed.any()
