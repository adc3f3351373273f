"""Traces of lumens: what brightens them, flow through them, sizes of short changes, walls."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, gaussian_filter1d
from scipy.special import ndtr

from kernels.arrays import FloatArray
from registration.alignment.distance import ModelSurface
from registration.measuring.gauging import (
    Defect,
    VesselTrace,
    printed_network,
    trace_vessels,
    without_gel_like,
)
from registration.measuring.gauging.changes import _defects, _Series
from registration.measuring.gauging.perfusion import fed_vessels, perfusion
from registration.measuring.gauging.sections import (
    RAYS,
    Planes,
    Sections,
    cut_sections,
    partial_noise,
)
from registration.measuring.gauging.walls.round_walls import RoundWalls
from registration.measuring.gauging.walls.wall_profile import wall_profile
from registration.segmentation import GelField, Segmentation, Strength, gel_evidence
from tests.registration.phantom import (
    CHANNEL,
    IDENTITY,
    VOXEL,
    WIDE,
    as_designed,
    block,
    ladder,
    ladder_construct,
    traces,
)
from tests.registration.test_defects import plug
from tests.slower import first_of

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


def test_what_closes_sections_stays_an_occlusion() -> None:
    trace = found(with_film(0.9, at=4.05))[CHANNEL]
    assert not trace.sections.open.all()
    assert not trace.gel_like.any()


def test_an_axis_out_of_view_is_not_seen_though_it_lies_in_a_junction() -> None:
    """Around a vessel's first stations is another's lumen: no wall that could be out of view."""
    whole = block()
    seen_mm = 1.5
    values = whole.field.values[:, :, : round((seen_mm + 0.4) / VOXEL)]
    half = replace(whole, field=replace(whole.field, values=np.ascontiguousarray(values)))
    for trace in trace_vessels(ladder(), half, IDENTITY, 0.1, ModelSurface.of(ladder_construct())):
        assert not trace.seen[trace.centre[:, 0] > seen_mm].any()


def at_the_mouth(content: Callable[[FloatArray], FloatArray]) -> VesselTrace:
    """The inlet, whose mouth is at x = 0, with something by x there."""
    scan = block(noise=0.004)
    x = scan.field.origin_mm[0] + VOXEL * np.arange(scan.field.values.shape[2])
    values = np.maximum(scan.field.values, content(x)).astype(np.float32)
    return found(replace(scan, field=replace(scan.field, values=values)))[0]


@pytest.mark.parametrize(
    ("content", "low", "high", "within"),
    [
        (lambda x, y, z: 0.3 * ((x > 3) & (x < 4.5)) + 0 * (y + z), 3, 4.5, 0.12),
        (lambda x, y, z: 0.4 * ((x > 3) & (x < 4.5)) + 0 * (y + z), 3, 4.5, 0.12),
        # Sediment in half of a lumen.
        (lambda x, y, z: 0.4 * ((z < 0) & (x > 3) & (x < 6)) + 0 * y, 3, 6, 0.25),
    ],
)
def test_weak_gel_over_a_stretch_is_found_over_all_of_it(content, low, high, within) -> None:
    trace = found(holding(content))[CHANNEL]
    marked = trace.along[trace.gel_like] + 1.7
    assert marked[[0, -1]] == pytest.approx([low, high], abs=within)
    if high < 6:
        assert trace.gel_like.sum() == pytest.approx(15, abs=2)


def test_weak_gel_or_faint_debris_all_along_is_found_by_the_other_lumens() -> None:
    whole = found(holding(lambda x, y, z: 0.4 + 0 * (x + y + z)))[CHANNEL]
    assert whole.gel_like.mean() > 0.9
    lower = found(holding(lambda x, y, z: 0.18 * (z < 0) + 0 * (x + y)))[CHANNEL]
    assert lower.own.mean() > 0.8
    assert lower.gel_like[lower.own].all()


def test_a_film_across_the_mouth_or_at_the_very_end_is_found_and_a_bright_bath_is_none() -> None:
    trace = at_the_mouth(lambda x: 0.4 * np.exp(-0.5 * ((x - 0.05) / 0.04) ** 2))
    assert np.flatnonzero(trace.gel_like).tolist() == [0]
    assert found(with_film(0.4, at=1.75))[CHANNEL].gel_like[0]
    assert not at_the_mouth(lambda x: 0.45 * np.clip(0.5 - x / 0.1, 0, 1)).gel_like.any()


@pytest.mark.parametrize(
    "content",
    [
        lambda x, y, z: 0 * (x + y + z),
        # Cells that thicken along a lumen.
        lambda x, y, z: 0.02 + 0.018 * (x - 1.7) + 0 * (y + z),
        # Light that gel above scatters on: it fades downwards, over 0.4 mm as in scans.
        lambda x, y, z: 0.1 * np.exp(-(0.25 - z) / 0.4) + 0 * (x + y),
        # A parent's own liquid isn't a plug of its branches, which reach into its lumen.
        lambda x, y, z: 0.16 + 0 * (x + y + z),
    ],
    ids=["sound", "cells", "scattered", "parent"],
)
def test_what_is_no_gel_leaves_all_lumens_open(content) -> None:
    assert not any(trace.gel_like.any() for trace in found(holding(content)))


def test_a_half_covered_lumen_its_neighbour_and_a_stenosis_are_no_films() -> None:
    assert not found(with_film(0.4, half=True))[CHANNEL].gel_like.any()
    assert not found(with_film(0.4))[WIDE].gel_like.any()
    scan = block(lambda vessel, along: -0.11 * (vessel == CHANNEL) * (abs(along - 2.3) < 0.15))
    assert not found(scan)[CHANNEL].gel_like.any()


# Flow through measured lumens, against Poiseuille's law by hand.


def test_a_rung_between_equal_pressures_is_fed_by_whatever_flows() -> None:
    """A sound print failed by a rung of 0.1 % of the flow, which half a per cent turned round."""
    designed, across = np.array([1.0, 1e-3, 1e-3, 1.0]), np.array([50.0, 0.05, 30.0, 50.0])
    printed = np.array([1.0, -2e-6, 2e-6, 0.005])
    fed = fed_vessels(printed, designed, across, 100.0)
    assert fed.tolist() == [True, True, False, False]
    assert not fed_vessels(0.0 * printed, designed, across, 100.0).any()


def test_split_follows_the_fourth_power() -> None:
    narrow = lambda v, along: np.full_like(along, -0.05 * (v == CHANNEL))  # noqa: E731
    found = perfusion(ladder(), traces(block(narrow)))
    assert found is not None
    r = 0.25
    ratio = found.resistance_pa_s_ul[CHANNEL] / found.designed_resistance_pa_s_ul[CHANNEL]
    assert ratio == pytest.approx((r / (r - 0.05)) ** 4, rel=0.06)
    conductance = 1 / found.resistance_pa_s_ul
    # The headers' share of each way's resistance is small, and the same in both.
    way = [1 / (1 / conductance[v] + 1 / conductance[h] + 1 / conductance[h + 4])
           for v, h in ((CHANNEL, 1), (WIDE, 2))]  # fmt: skip
    assert found.share[CHANNEL] == pytest.approx(way[0] / sum(way), abs=0.01)


def test_occluded_channel_takes_no_flow_and_the_other_takes_all() -> None:
    found = perfusion(ladder(), traces(block(filled=plug(2.3, 3.1))))
    assert found is not None
    assert found.resistance_pa_s_ul[CHANNEL] == np.inf
    assert found.flow_ul_s[CHANNEL] == 0
    assert found.share[WIDE] == pytest.approx(1)
    assert found.perfused is False
    assert not found.fed[CHANNEL]
    assert found.fed[WIDE]
    assert found.inflow_ul_s == pytest.approx(1)


def test_oval_lumen_conducts_less_than_a_round_one_of_its_area() -> None:
    def squeeze(points):
        """An ellipse of 0.34 by 0.2 mm in place of the first channel."""
        y, z = points[..., 1] - 1.2, points[..., 2] - 1.3
        inside = np.abs(points[..., 0] - 4.5) - 2.0
        ellipse = (np.hypot(y / 0.34, z / 0.20) - 1) * 0.25
        return ellipse, np.maximum(np.hypot(y, z) - 0.45, inside)

    def filled(points):
        ellipse, tube = squeeze(points)
        return np.maximum(tube, -ellipse)

    def extra(points):
        ellipse, tube = squeeze(points)
        return np.maximum(tube, ellipse)

    # Gel is put back after the hole is made, so both leave the ellipse.
    found = traces(block(extra=extra, filled=filled))[CHANNEL]
    middle = np.abs(found.along - 2.8) < 1.0
    np.testing.assert_allclose(found.sections.ovality[middle], 0.34 / 0.20, rtol=0.06)
    np.testing.assert_allclose(found.sections.area[middle], np.pi * 0.34 * 0.20, rtol=0.03)
    radius = printed_network(ladder(), traces(block(extra=extra, filled=filled)))
    along = radius.polyline(CHANNEL)[1][1:-1][middle]
    a, b = 0.34, 0.20
    np.testing.assert_allclose(along**4, 2 * (a * b) ** 3 / (a * a + b * b), rtol=0.08)


def test_blocked_inlet_perfuses_nothing() -> None:
    block_in = block(filled=lambda p: np.abs(p[..., 0] - 0.8) - 0.2)
    found = perfusion(ladder(), traces(block_in))
    assert found is not None
    assert found.perfused is False
    assert (found.flow_ul_s == 0).all()
    assert np.isnan(found.pressure_drop_pa)


# Sections of which only part of the wall is a vessel's own.


RADIUS_MM, BLUR_MM = 0.15, 0.02


def sections(met: float, scatter: float, seed: int, count: int = 400) -> Sections:
    """Lumens of `RADIUS`, of whose rays the others look into a neighbour and aren't met."""
    random = np.random.default_rng(seed)
    rays = RADIUS_MM + scatter * random.standard_normal((count, RAYS))
    rays[:, round(met * RAYS) :] = np.nan
    share = np.isfinite(rays).mean(axis=1)
    nothing = np.full(count, np.nan)
    median = 2 * np.nanmedian(rays, axis=1)
    yes, no = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
    return Sections(
        yes, no, nothing, median, share, nothing, np.zeros((count, 2)), rays, nothing, nothing
    )


@pytest.mark.parametrize("met", [0.6, 0.75, 0.9])
@pytest.mark.parametrize("scatter", [0.002, 0.004])
def test_the_interval_holds_the_diameter(met, scatter):
    found = sections(met, scatter, seed=3)
    noise = partial_noise(found, BLUR_MM)
    inside = np.abs(found.median - 2 * RADIUS_MM) < 1.96 * noise
    assert inside.mean() > 0.95
    # It isn't so wide that it says nothing.
    assert np.median(noise) < 4 * scatter + 0.6 * BLUR_MM


FINE_MM = 0.005


def beside(ways: list[float], gap: float, blur: float) -> tuple[Sections, float]:
    """Section of a lumen of `RADIUS` with lumens as wide in these directions (radians), blurred.

    Gel of `gap` mm is between; returns the section and the standard error of its median.
    """
    half = 4 * RADIUS_MM + 4 * blur
    y, x = np.mgrid[-half : half + FINE_MM / 2 : FINE_MM, -half : half + FINE_MM / 2 : FINE_MM]
    wall = np.hypot(x, y) - RADIUS_MM
    for way in ways:
        off = 2 * RADIUS_MM + gap
        other = np.hypot(x - off * np.cos(way), y - off * np.sin(way)) - RADIUS_MM
        wall = np.minimum(wall, other)
    gel = gaussian_filter(np.clip(wall / FINE_MM + 0.5, 0.0, 1.0), blur / FINE_MM)
    values = np.repeat(gel[None].astype(np.float32), 3, axis=0)
    field = GelField(
        values, 0.5, 1.0, np.full(3, FINE_MM), np.array([-half, -half, -FINE_MM]), blur_mm=blur
    )
    found = cut_sections(
        field, Planes(np.zeros((1, 3)), np.eye(3)[None, :2], np.full(1, RADIUS_MM))
    )
    return found, float(partial_noise(found, blur)[0])


@pytest.mark.parametrize(
    "ways", [[0.0], [0.0, np.pi], [0.3, 1.5], [0.0, np.pi / 3, 2 * np.pi / 3, np.pi]]
)
@pytest.mark.parametrize("gap", [0.2, 0.6, 1.0])
@pytest.mark.parametrize("blur", [0.2, 0.35, 0.5])
def test_gel_thinner_than_the_blur_is_in_the_interval(ways, gap, blur):
    sigma = blur * RADIUS_MM
    found, noise = beside(ways, gap * sigma, sigma)
    assert found.open.all()
    if found.closed_outline[0] or np.isnan(noise):
        return
    assert abs(found.median[0] - 2 * RADIUS_MM) < 1.96 * noise


# Changes as short as a few blurs hold.


FINE, BLUR, NOISE = 0.001, 0.03, 0.003


def blurred(shape: Callable[[FloatArray], FloatArray], along: FloatArray) -> FloatArray:
    """A change as sections show it: blurred along the vessel, sampled at stations."""
    fine = np.arange(along[0] - 1, along[-1] + 1, FINE)
    return np.interp(along, fine, gaussian_filter1d(shape(fine), BLUR / FINE, truncate=6))


def listed(shape: Callable[[FloatArray], FloatArray]) -> Defect:
    trace = traces(block())[CHANNEL]
    change = blurred(shape, trace.along)
    nothing = np.zeros((len(change), RAYS))
    score = change / NOISE
    noise = np.full(len(change), NOISE)
    series = _Series(trace, change, noise, 0.0, nothing, score, nothing, 5.0, BLUR)
    (found,) = _defects(series)
    return found


@pytest.mark.parametrize("off", first_of([0.02, 0.0, 0.05]))
@pytest.mark.parametrize(
    "shape",
    [
        lambda z: -0.18 * (np.abs(z) < 0.1),
        lambda z: -0.18 * (np.abs(z) < 0.15),
        lambda z: 0.18 * np.clip((0.125 - np.abs(z)) / 0.05, 0, 1),
        lambda z: -0.18 * np.clip(1 - np.abs(z) / 0.25, 0, 1),
        lambda z: -0.18 * np.exp(-0.5 * (z / 0.1) ** 2),
        lambda z: 0.18 * np.exp(-0.5 * (z / 0.15) ** 2),
    ],
)
def test_a_short_change_lies_in_its_interval(shape, off):
    middle = 3.0 + off
    found = listed(lambda along: shape(along - middle))
    assert abs(abs(found.size_um) - 180) <= found.error_um < 45


# Walls by the mean light across them.


SPREAD, PLACE = 0.015, 0.008


@cache
def lined(
    line_mm: float, speckle: Literal["one look", "heavy tails"] = "one look", level: bool = False
) -> Segmentation:
    """The block, its walls with a line of so much gel; `level`: only those that face the light."""
    found = block(as_designed)
    u = (0.3 * (found.field.values.astype(float) - 0.5) - PLACE) / SPREAD
    slope = np.exp(-u * u / 2) / (np.sqrt(2 * np.pi) * SPREAD)
    if level:
        z, y, x = np.gradient(u)
        slope *= np.abs(z) > 0.75 * np.sqrt(x * x + y * y + z * z)
    rng = np.random.default_rng(5)
    light = (ndtr(u) + line_mm * slope) * rng.exponential(size=u.shape)
    if speckle == "heavy tails":
        light *= rng.gamma(1.0, size=u.shape)
    strength = Strength(light.astype(np.float32), 0.01, light.astype(np.float16))
    return replace(found, strength=strength, field=replace(found.field, faint_mm=0.006))


@pytest.mark.parametrize("speckle", ["one look", "heavy tails"])
def test_walls_are_found_whatever_the_law_of_speckle(speckle: Literal["one look", "heavy tails"]):
    found = wall_profile(traces(lined(0.0, speckle)), lined(0.0, speckle))
    assert found is not None
    assert found.place_mm == pytest.approx(PLACE, abs=0.002)
    assert found.error_mm < 0.002


@pytest.mark.parametrize("line_mm", [0.0, 0.003, 0.006])
def test_a_line_as_smooth_as_its_wall_shows_nothing_but_lies_in_its_interval(line_mm: float):
    found = wall_profile(traces(lined(line_mm)), lined(line_mm))
    assert found is not None
    line, unknown = found.line_mm
    assert found.place_mm == pytest.approx(PLACE - line_mm, abs=0.002)
    assert abs(line - line_mm) < 2 * unknown < 0.006


@pytest.mark.parametrize("radius", [4.0, 6.0, 12.0])
def test_a_round_lumen_is_as_wide_as_its_blurred_section_says(radius: float) -> None:
    """By a blur and a level that aren't the wall's middle: the disc itself is drawn and blurred."""
    y, x = np.mgrid[-40:41, -40:41]
    away = np.hypot(x, y)
    sharp = np.clip(away - radius + 0.5, 0, 1)
    grey = -1.2 + 3.0 * gaussian_filter(sharp, 3.0, truncate=6)
    row = grey[40, 40:]
    found = float(np.interp(0.0, row, np.arange(41.0)))
    walls = RoundWalls(liquid=-1.2, gel=1.8, blur_mm=3.0)
    assert walls.radius(np.array([found]))[0] == pytest.approx(radius, abs=0.08)
    assert abs(found - radius) > 0.05
