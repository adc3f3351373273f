"""Sections, diameters and deviations, on known shapes."""

from dataclasses import asdict, replace
from functools import cache

import manifold3d
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from design.geometry.surface import Surface
from design.network import VesselNetwork
from design.solids.solid import Solid
from registration.alignment import Fit
from registration.alignment.distance import ModelSurface
from registration.alignment.uncertainty import ScanErrors, section_errors
from registration.measuring.gauging import (
    ScannedSurface,
    VesselTrace,
    deviations,
    find_changes,
    hausdorff_p95_um,
    summarise,
    surface_points,
    trace_vessels,
    with_designed_walls,
    with_mouths,
    with_own_levels,
)
from registration.measuring.gauging.openings.face_places import FacePlace, ScannedFaces
from registration.measuring.gauging.sections import Planes, cut_sections, oval_conductance
from registration.measuring.gauging.vessels import Oval, ovality, unmeasured_stations
from registration.segmentation import GelField, Segmentation, Strength
from report.sections.facts import place_rows
from tests.design.networks import network, polyline
from tests.registration.parts import (
    HERE,
    lumen_distance,
    lumens,
    planar_construct,
    segmented,
    solid,
)
from tests.slower import first_rows

VOXEL = np.array([0.05, 0.05, 0.04])


def bore(radius: float, centre_y: float = 1.5, plug: tuple[float, float] = (9, 9)) -> GelField:
    """Gel with a straight lumen along x at (y, z) = (centre_y, 1.5); full between the plug's x."""
    z, y, x = np.meshgrid(*(np.arange(n) for n in (75, 60, 60)), indexing="ij")
    away = np.hypot(y * VOXEL[1] - centre_y, z * VOXEL[2] - 1.5) - radius
    gel = np.where((x * VOXEL[0] > plug[0]) & (x * VOXEL[0] < plug[1]), 1.0, away)
    values = np.clip(0.5 + gel / 0.2, 0, 1).astype(np.float32)
    return GelField(values, 0.5, 1.0, VOXEL, np.zeros(3), blur_mm=0.0)


def planes(radius: float, xs: list[float]) -> Planes:
    n = len(xs)
    centre = np.array([[x, 1.5, 1.5] for x in xs])
    across = np.broadcast_to(np.array([[0.0, 1, 0], [0, 0, 1]]), (n, 2, 3)).copy()
    return Planes(centre, across, np.full(n, radius))


@pytest.mark.parametrize("radius", [0.2, 0.35, 0.5])
def test_diameter_of_a_bore_is_right_to_two_micrometres(radius: float) -> None:
    found = cut_sections(bore(radius), planes(radius, [0.8, 1.5, 2.1]))
    assert found.closed_outline.all()
    np.testing.assert_allclose(found.diameter, 2 * radius, atol=0.002)
    np.testing.assert_allclose(found.offset, 0, atol=0.002)


def test_plug_is_closed_and_beside_it_open() -> None:
    found = cut_sections(bore(0.3, plug=(1.2, 1.8)), planes(0.3, [0.8, 1.5, 2.2]))
    np.testing.assert_array_equal(found.open, [True, False, True])
    assert found.diameter[1] == 0


def test_known_blur_is_undone_to_first_order() -> None:
    radius, blur = 0.3, 0.08
    field = bore(radius - blur**2 / (2 * radius))
    blurred = GelField(field.values, 0.5, 1.0, VOXEL, np.zeros(3), blur_mm=blur)
    found = cut_sections(blurred, planes(radius, [1.5]))
    assert found.diameter[0] == pytest.approx(2 * radius, abs=0.004)


def test_beside_a_sibling_at_a_narrow_angle_no_diameter_is_measured() -> None:
    """Two vessels part at 9 degrees: until there is gel between them neither has a wall there."""
    nodes = [[0.0, 0, 0], [2, 0, 0], [8, 0.48, 0], [8, -0.48, 0]]
    fork = network(nodes, [[0, 1], [1, 2], [1, 3]], [0.3, 0.25, 0.25])
    low = np.array([-0.5, -1.5, -0.9])
    axes = [np.arange(a, b, 0.05) for a, b in zip(low, (8.5, 1.5, 0.9), strict=True)]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    away = lumen_distance(fork, np.stack([x, y, z], axis=-1))
    found = segmented(np.clip(0.5 + away / 0.3, 0, 1), 0.05, low)
    traces = trace_vessels(fork, found, HERE, 0.1)
    trace = traces[1]
    # The axes are as far apart as the two lumens are wide only after 6 · 0.25 / 0.48 mm.
    assert trace.along[trace.counted].min() > 6 * 0.25 / 0.48
    np.testing.assert_allclose(trace.diameter[trace.counted], 0.5, atol=0.01)
    assert find_changes(traces, 1.0) == []


LONG = polyline([[0.0, 0, 0], [4.8, 0, 0]], 0.3)
LOW, HIGH = np.array([-0.3, -0.9, -0.9]), np.array([4.9, 3.1, 0.9])


def as_designed(design: VesselNetwork) -> Segmentation:
    """A design as printed exactly, from `LOW` to `HIGH`, mm."""
    axes = [np.arange(a, b, 0.04) for a, b in zip(LOW, HIGH, strict=True)]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    away = lumen_distance(design, np.stack([x, y, z], axis=-1))
    return segmented(np.clip(0.5 + away / 0.24, 0, 1), 0.04, LOW)


def test_no_wall_is_missed_where_the_design_has_none() -> None:
    """Sections beside a right angle run along the other leg, where there is no wall all round."""
    bent = polyline([[0.0, 0, 0], [3, 0, 0], [3.0, 2.9, 0]], 0.3)
    traces = trace_vessels(bent, as_designed(bent), HERE, 0.1)
    surface = ModelSurface.of(solid(lumens(bent)))
    (trace,) = with_designed_walls(traces, HERE, surface, True)
    assert unmeasured_stations(traces[0]).any()
    assert not unmeasured_stations(trace).any()
    straight = with_designed_walls(traces, HERE, ModelSurface.of(solid(lumens(LONG))), True)[0]
    assert unmeasured_stations(straight).any()  # a wall that the design has is missed


@pytest.mark.parametrize("is_lumen", [True, False])
def test_a_kink_is_compared_with_the_designed_surface(is_lumen: bool) -> None:
    """Across a kink of 70 degrees the design is wider than the network's diameter, and no bulge."""
    kinked = polyline([[0.0, 0, 0], [3, 0, 0], [4.0, 2.8, 0]], 0.3)
    low, high, found = LOW, HIGH, as_designed(kinked)
    model = lumens(kinked)
    if not is_lumen:
        block = manifold3d.Manifold.cube(tuple(high - low)).translate(tuple(low))
        model = block - model
    traces = trace_vessels(kinked, found, HERE, 0.1)
    designed = with_designed_walls(traces, HERE, ModelSurface.of(solid(model)), is_lumen)
    (trace,), kink = designed, np.abs(traces[0].along - 3.0) < 0.1
    assert trace.counted[kink].all()
    assert trace.designed[kink].min() > 0.63
    counted = trace.counted
    np.testing.assert_allclose(trace.diameter[counted], trace.designed[counted], atol=0.012)
    straight = np.abs(trace.along - 1.5) < 0.5
    np.testing.assert_allclose(trace.designed[straight], 0.6, atol=0.004)
    assert max(abs(d.size_um) for d in find_changes(traces, 1.0)) > 30
    assert all(abs(d.size_um) < 5 for d in find_changes(designed, 1.0))


def test_an_oval_conducts_less_than_a_circle_of_its_area() -> None:
    a, b = 0.34, 0.20  # semi-axes: q is as a³ b³ / (a² + b²), of the circle as (ab)² / 2
    ratio = 2 * a * b / (a * a + b * b)
    found = oval_conductance(np.array([a / b, 1.0, np.nan]))
    np.testing.assert_allclose(found, [ratio, 1.0, 1.0])


# Ovality of lumens: found as made, whatever single sections scatter.

VOXEL_OVALITY, LENGTH, RADIUS = 0.025, 3.0, 0.2
LINE = polyline([[0.0, 0.0, 0.0], [LENGTH, 0.0, 0.0]], RADIUS)


def measured(ratio: float, length: float = LENGTH, noise: float = 0.0, seed: int = 4) -> Oval:
    """A lumen with this ratio of its axes and a circle's area, over a length from its start."""
    x, side = np.arange(-0.3, LENGTH + 0.3, VOXEL_OVALITY), np.arange(-0.6, 0.6, VOXEL_OVALITY)
    z, y, x = np.meshgrid(side, side, x, indexing="ij")
    long = np.where(x < length, np.sqrt(ratio), 1.0)
    scaled = np.hypot(y / long, z * long)
    gel = (scaled - RADIUS) * RADIUS / np.maximum(np.hypot(y / long**2, z * long**2), 1e-6)
    rough = gaussian_filter(np.random.default_rng(seed).normal(size=gel.shape), 1.0)
    gel = gel + noise * rough / rough.std()
    values, origin = np.clip(0.5 + gel / 0.15, 0, 1), np.array([-0.3, -0.6, -0.6])
    found = segmented(values, VOXEL_OVALITY, origin, VOXEL_OVALITY)
    (trace,) = trace_vessels(LINE, found, HERE, 0.1)
    errors, counted = ScanErrors.of_blur(VOXEL_OVALITY), trace.counted
    own = section_errors(
        errors, trace.diameter[counted], trace.sections.noise[counted],
        trace.planes.across[counted], trace.spacing,
    )  # fmt: skip
    return ovality(trace, own, errors)


@pytest.mark.parametrize("ratio", [1.2, 2.0])
def test_the_widths_differ_as_made(ratio: float) -> None:
    found = measured(ratio)
    made = 2e3 * RADIUS * (np.sqrt(ratio) - np.sqrt(1 / ratio))
    assert found.widths_um == pytest.approx(made, abs=0.1 * made)


def test_a_short_oval_is_found_where_it_is_and_noise_is_none() -> None:
    found = measured(2.0, length=0.9)
    assert found.widths_um > 200.0
    assert found.at_mm < 0.9
    found = measured(1.0, noise=0.012)
    assert found.widths_um < 40.0
    assert 5.0 < found.u_um < 40.0


def test_the_interval_of_a_round_lumens_most_oval_window_holds_zero() -> None:
    """It is the most oval of several, by noise alone."""
    found = [measured(1.0, noise=0.012, seed=seed) for seed in range(12)]
    assert sum(one.widths_um > one.u_um + 1e-6 for one in found) <= 1


# Short vessels beside thin gel: walls halfway between their own levels.


RUNG_MM, BLUR_MM, FINE = 0.15, 0.03, 0.025


GAP = 1.5 * BLUR_MM


X = (0.6, 0.6 + 2 * RUNG_MM + GAP, 0.6 + 4 * RUNG_MM + 2 * GAP)


RUNGS_MM = np.array([X[2] + 0.6, 2.6, 1.6])


@cache
def row() -> VesselNetwork:
    """Three rungs side by side between two trunks, and a channel of its own below them."""
    low, high = 0.7, 1.6
    nodes = [(0.0, low, 0.8), *((x, low, 0.8) for x in X), (RUNGS_MM[0], low, 0.8)]
    nodes += [(0.0, high, 0.8), *((x, high, 0.8) for x in X), (RUNGS_MM[0], high, 0.8)]
    nodes += [(0.0, 2.2, 0.5), (RUNGS_MM[0], 2.2, 0.5)]
    ends = [(0, 1), (1, 2), (2, 3), (5, 6), (6, 7), (7, 8), (1, 6), (2, 7), (3, 8), (10, 11)]
    radius = [0.16] * 6 + [RUNG_MM] * 4
    return network(nodes, ends, radius)


@cache
def share() -> tuple[np.ndarray, np.ndarray]:
    """Blurred share of gel of each voxel, and the first voxel's place."""
    axes = [np.arange(-0.2, size + 0.2, FINE) for size in RUNGS_MM]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    points = np.stack([x, y, z], axis=-1)
    wall = np.full(x.shape, np.inf)
    for (a, b), radius in row().polylines():
        along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        away = np.linalg.norm(points - a - along[..., None] * (b - a), axis=-1)
        wall = np.minimum(wall, away - radius[0])
    outside = (np.abs(points - RUNGS_MM / 2) - RUNGS_MM / 2).max(axis=-1)
    gel = np.clip(0.5 + np.minimum(wall, -outside) / FINE, 0, 1)
    return gaussian_filter(gel, BLUR_MM / FINE), points[0, 0, 0]


def scanned(gel: float, liquid: float, *, oct_scan: bool = True) -> Segmentation:
    """The row's scan, its levels off by what `gel` and `liquid` differ from 1 and 0."""
    part, origin = share()
    values = (liquid + (gel - liquid) * part).astype(np.float32)
    strength = Strength(values, 0.0, values.astype(np.float16)) if oct_scan else None
    return segmented(values, FINE, origin, BLUR_MM, contrast=50.0, strength=strength)


MIDDLE = 7


@cache
def construct() -> Solid:
    return solid(manifold3d.Manifold.cube(tuple(RUNGS_MM)) - lumens(row()))


def gauged(seen: Segmentation, *, part: bool = True) -> tuple[list[VesselTrace], list[VesselTrace]]:
    """Traces before and after."""
    fit = Fit(np.eye(3), np.zeros(3), np.ones(3), RUNGS_MM / 2)
    surface = ModelSurface.of(construct()) if part else None
    before = trace_vessels(row(), seen, fit, 0.05, surface)
    return list(before), list(with_own_levels(before, seen, fit, surface))


def mean(trace: VesselTrace) -> float:
    assert trace.sections.closed_outline[trace.counted].all()
    return float(trace.diameter[trace.counted].mean())


@pytest.mark.parametrize(
    ("gel", "liquid"), first_rows([(0.92, -0.03), (1.06, 0.0), (0.9, 0.0), (1.0, -0.05)], 2)
)
def test_walls_lie_halfway_between_their_own_levels(gel: float, liquid: float):
    right = mean(gauged(scanned(1.0, 0.0))[1][MIDDLE])
    before, after = gauged(scanned(gel, liquid))
    off = np.sqrt(2 * np.pi) * BLUR_MM * (1 - gel - liquid)
    assert mean(before[MIDDLE]) - right == pytest.approx(off, rel=0.35)
    assert abs(mean(after[MIDDLE]) - right) < 0.25 * abs(off)


def test_right_levels_move_nothing():
    before, after = gauged(scanned(1.0, 0.0))
    assert mean(after[MIDDLE]) == pytest.approx(mean(before[MIDDLE]), abs=0.05 * BLUR_MM)


# A lumen that meets the part's face at a slant is seen and measured to its end.


SLANTED_MM = np.array([5.0, 5.0, 2.0])
COARSE = 0.04
SLANTED = polyline([[0.0, 2.5, 1.0], [5.0, 4.5, 1.0]], 0.4)
"""One vessel, at 22 degrees to the normal of the faces that it opens in."""
STEEP = polyline([[0.0, 0.6, 1.0], [4.4, 5.0, 1.0]], 0.4)
"""One at 45 degrees."""


def traced(
    low: float, high: float, plug_mm: float = 0.0, neck: float = 0.0,
    network: VesselNetwork = SLANTED,
) -> VesselTrace:  # fmt: skip
    """The block with its vessel in a field from x = `low` to `high`; gel in its last `plug_mm`.

    Its first 0.5 mm are narrower by `neck` all round, mm.
    """
    axes = [np.arange(a, b, COARSE) for a, b in ((low, high), (-0.3, 5.3), (-0.3, 2.3))]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    points = np.stack([x, y, z], axis=-1)
    lumen = lumen_distance(network, points)
    ((ends, _),) = network.polylines()
    way = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    lumen = lumen + neck * ((points - ends[0]) @ way < 0.5)
    if plug_mm:
        lumen = np.where(x > SLANTED_MM[0] - plug_mm, 1.0, lumen)
    gel = np.minimum(np.minimum(points, SLANTED_MM - points).min(axis=-1), lumen)
    found = segmented(np.clip(0.5 + gel / (6 * COARSE), 0, 1), COARSE, [axis[0] for axis in axes])
    part = ModelSurface.of(solid(manifold3d.Manifold.cube(tuple(SLANTED_MM)) - lumens(network)))
    (trace,) = with_mouths(trace_vessels(network, found, HERE, 0.1, part), found, HERE, part)
    return trace


def test_no_wall_is_looked_for_where_the_design_has_none_and_a_plug_is_told() -> None:
    found = traced(-0.1, 5.1)
    assert found.seen.all()
    assert found.sections.open.all()
    found = traced(-0.1, 5.1, plug_mm=0.5)
    assert (found.seen & ~found.sections.open).any()


@pytest.mark.parametrize(("low", "high"), [(0.5, 5.1), (-0.1, 4.5)])
def test_walls_that_lie_past_the_field_are_not_seen(low: float, high: float) -> None:
    found = traced(low, high)
    x = found.centre[:, 0]
    assert not found.seen[(x < low) | (x > high)].any()
    assert found.seen[(x > low + 0.3) & (x < high - 0.3)].all()


@pytest.mark.parametrize("network", [SLANTED, STEEP])
def test_a_neck_in_a_mouth_is_measured_by_the_wall_that_lies_in_the_gel(network):
    found = traced(-0.3, 5.3, neck=0.15, network=network)
    whole = found.counted & found.sections.closed_outline
    cut = found.counted & ~found.sections.closed_outline
    necked = found.counted & (found.along < 0.4)
    assert found.along[necked].min() < 0.26  # the first whole section lies at 0.35, and at 0.55
    assert found.diameter[necked] == pytest.approx(0.5, abs=0.03)
    assert found.diameter[cut & (found.along > 1)] == pytest.approx(0.8, abs=0.03)
    assert found.diameter[whole & (found.along > 1)] == pytest.approx(0.8, abs=0.02)
    assert cut.any() or network is SLANTED
    assert (found.sections.noise[cut] > found.sections.noise[whole].min()).all()


# Deviation of surfaces in both directions.


BALL_VOXEL = 0.04


def ball_scan(radius: float, middle: tuple[float, float, float] = (0, 0, 0)) -> Segmentation:
    """A ball of gel in liquid, as segmented."""
    axis = np.arange(-1.6, 1.6, BALL_VOXEL)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    away = np.sqrt((x - middle[0]) ** 2 + (y - middle[1]) ** 2 + (z - middle[2]) ** 2)
    return segmented(np.clip(0.5 + (radius - away) / 0.3, 0, 1), BALL_VOXEL, np.full(3, -1.6))


def deviations_back(points: np.ndarray, scan: Segmentation, fit: Fit) -> np.ndarray:
    return ScannedSurface.of(scan).deviations_back(points, fit)


def ball_model(radius: float) -> ModelSurface:
    return ModelSurface.of(solid(manifold3d.Manifold.sphere(radius, 128)))


@pytest.mark.parametrize("excess", [-0.06, 0.0, 0.08])
def test_larger_ball_deviates_negatively_by_its_excess_both_ways(excess: float) -> None:
    model, scan = ball_model(1.0), ball_scan(1.0 + excess)
    there = deviations(model, scan.surface.vertices, False)
    back = deviations_back(surface_points(model, 5000), scan, HERE)
    np.testing.assert_allclose(there, -excess, atol=0.004)
    np.testing.assert_allclose(back, -excess, atol=0.004)
    assert hausdorff_p95_um(there, back) == pytest.approx(1e3 * abs(excess), abs=4)


def test_eccentric_ball_deviates_by_the_cosine() -> None:
    model, scan = ball_model(1.0), ball_scan(1.0, (0.1, 0, 0))
    points = surface_points(model, 4000)
    back = deviations_back(points, scan, HERE)
    expected = np.linalg.norm(points - [0.1, 0, 0], axis=1) - 1
    np.testing.assert_allclose(back, expected, atol=0.004)
    found = summarise(back)
    assert found.mean_um == pytest.approx(0, abs=5)
    # Over a ball x is uniform in [-1, 1].
    assert found.rms_um == pytest.approx(100 / np.sqrt(3), rel=0.05)
    assert found.max_um == pytest.approx(100, abs=5)


def test_what_isnt_in_the_field_of_view_isnt_measured_back() -> None:
    scan = ball_scan(1.0)
    field = replace(scan.field, values=scan.field.values[:, :, : int(1.6 / BALL_VOXEL)])
    part = replace(scan, field=field)
    points = surface_points(ball_model(1.0), 4000)
    assert len(deviations_back(points, part, HERE)) == pytest.approx(2000, rel=0.08)


def test_way_back_is_exact_in_any_frame() -> None:
    scan = ball_scan(1.0)
    turn = Rotation.from_euler("xyz", (4, -3, 8), degrees=True).as_matrix()
    fit = Fit(turn, np.array([0.05, -0.02, 0.01]), np.array([1.02, 0.98, 1.01]), np.zeros(3))
    points = surface_points(ball_model(1.0), 2000)
    surface = ModelSurface.of(Solid(fit.apply(scan.surface.vertices), scan.surface.faces))
    found = deviations_back(points, scan, fit)
    # The facets' side, and the field's, of the few points that lie on the surface may differ.
    np.testing.assert_allclose(np.abs(found), np.abs(surface.query(points).distance), atol=1e-12)
    assert (np.sign(found) == np.sign(surface.query(points).distance)).mean() > 0.99


# Chips and bumps on a scanned face are listed where they are; noise and rounded rims aren't.

SIDE, STEP = 200, 0.025


def face() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A face of 5 × 5 mm with speckle of 12 µm, correlated over 60 µm: vertices, triangles, µm."""
    x, y = np.meshgrid(STEP * np.arange(SIDE), STEP * np.arange(SIDE), indexing="ij")
    corner = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    triangles = [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    noise = gaussian_filter(np.random.default_rng(5).normal(size=x.shape), 2.4, mode="wrap")
    vertices = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    return vertices, np.concatenate(triangles).astype(np.int32), 12 * noise.ravel() / noise.std()


def listed(off: np.ndarray, rims: np.ndarray | None = None) -> tuple[FacePlace, ...]:
    vertices, triangles, _ = face()
    none = np.zeros(len(off), dtype=bool)
    known = off[np.isfinite(off)]
    spread = 1.4826 * np.median(np.abs(known - np.median(known))) if len(known) else 0.0
    rims = none if rims is None else rims
    return ScannedFaces(Surface(vertices, triangles), off, rims, 50, float(spread)).places_off()


def away(x: float, y: float) -> np.ndarray:
    vertices = face()[0]
    return np.hypot(vertices[:, 0] - x, vertices[:, 1] - y)


def test_a_pit_and_a_bump_are_listed_with_sign_size_and_place() -> None:
    off = face()[2] + 300 * (away(3.0, 1.5) < 0.4) - 200 * (away(1.0, 4.0) < 0.3)
    pit, bump = listed(off)
    assert pit.deviation_um == pytest.approx(300, abs=30)
    assert bump.deviation_um == pytest.approx(-200, abs=30)
    assert pit.area_mm2 == pytest.approx(np.pi * 0.4**2, rel=0.1)
    np.testing.assert_allclose(pit.at_mm, [3.0, 1.5, 0], atol=0.4)
    np.testing.assert_allclose(bump.at_mm, [1.0, 4.0, 0], atol=0.3)
    rows = place_rows({"by_surface": {"outer_faces": {"places": [asdict(pit), asdict(bump)]}}})
    assert [float(row[1]) for row in rows] == pytest.approx([0.5, 0.28], abs=0.05)


def test_direction_is_the_gradient_of_the_distance() -> None:
    surface = ModelSurface.of(planar_construct())
    points = np.random.default_rng(2).uniform([0, 0, 0], [16, 8, 3], (300, 3))
    here = surface.query(points)
    ahead = surface.query(points + 1e-5 * here.direction).distance
    back = surface.query(points - 1e-5 * here.direction).distance
    np.testing.assert_allclose((ahead - back) / 2e-5, 1.0, atol=0.02)
