"""Planted defects are found with place and size, none in clean phantoms; leaks; topology."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage.measure import euler_number as peer_euler

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.alignment import Alignment, Uncertainty
from registration.alignment.distance import ModelSurface
from registration.alignment.uncertainty import ScanErrors
from registration.findings import Findings, Inspection, inspect
from registration.measuring.gauging import Defect, VesselTrace, deviations, find_junction_changes
from registration.measuring.topology import (
    Betti,
    betti_numbers,
    lay_grid,
    leaks,
    overlap,
    scanned_with,
)
from registration.measuring.topology.compare import euler_number
from registration.measuring.topology.gel_paths import find_gel_paths
from registration.options import RegistrationOptions
from registration.segmentation import GelField, Segmentation, Strength, gel_evidence
from tests.design.networks import polyline
from tests.registration.phantom import (
    BLOCK,
    CHANNEL,
    IDENTITY,
    VOXEL,
    WIDE,
    block,
    ladder,
    ladder_construct,
)
from tests.slower import examples, first_of

NOISE = 0.004
ERRORS = ScanErrors(0.005, 0.005, 0.0, 50.0, 0.0, 0.0, 0.04, np.array([0.0, 0.0, 1.0]))
SURE = Uncertainty(np.zeros(3), np.zeros(3), np.zeros(3), 0.0)


def findings(segmentation: Segmentation) -> Findings:
    surface = ModelSurface.of(ladder_construct())
    deviation = deviations(surface, segmentation.surface.vertices, False)
    fits = Alignment(IDENTITY, IDENTITY, 2, True, np.inf, (), SURE, "upright", ())
    evidence = gel_evidence(segmentation.field, segmentation.strength)
    scan: Any = None  # it is segmented already
    options = RegistrationOptions(false_alarm=1e-3)
    case = (scan, ladder_construct(), ladder(), options, segmentation, surface, False, ERRORS, 0.1)
    return inspect(Inspection(*case, fits, deviation, evidence))


def hump(vessel: int, at: float, height: float, sigma: float):
    def change(v: int, along: FloatArray) -> FloatArray:
        return height * np.exp(-0.5 * ((along - at) / sigma) ** 2) * (v == vessel)

    return change


def plug(low: float, high: float, radius: float = 0.4):
    """Gel in the first channel between two places along it, with flat ends."""

    def distance(points: FloatArray) -> FloatArray:
        away = np.hypot(points[..., 1] - 1.2, points[..., 2] - 1.3) - radius
        middle, half = 1.7 + (low + high) / 2, (high - low) / 2
        return np.maximum(away, np.abs(points[..., 0] - middle) - half)

    return distance


def hole(start: tuple[float, float, float], end: tuple[float, float, float], radius: float):
    a, b = np.array(start), np.array(end)

    def distance(points: FloatArray) -> FloatArray:
        t = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        return np.linalg.norm(points - a - t[..., None] * (b - a), axis=-1) - radius

    return distance


@pytest.mark.parametrize("seed", first_of(range(6)))
def test_clean_print_has_no_defect(seed: int) -> None:
    found = findings(block(noise=NOISE * (1 + seed), seed=seed))
    assert found.defects == ()
    assert found.topology.as_designed is True


def test_bulge_is_found_where_it_is_with_its_size() -> None:
    found = findings(block(hump(WIDE, 3.0, 0.060, 0.25), noise=NOISE)).defects
    assert [(d.kind, d.vessel) for d in found] == [("bulge", WIDE)]
    (defect,) = found
    assert defect.size_um == pytest.approx(120, abs=10)
    assert defect.wall_um == pytest.approx(60, abs=10)
    assert defect.at_mm == pytest.approx(3.0, abs=0.1)
    assert defect.from_mm < 3.0 < defect.to_mm
    np.testing.assert_allclose(defect.point_mm, (4.7, 3.2, 1.3), atol=0.1)
    assert 0 < defect.error_um < 15
    assert defect.seen


def test_half_stenosis_is_found_with_its_size() -> None:
    found = findings(block(hump(CHANNEL, 2.0, -0.125, 0.3), noise=NOISE)).defects
    assert [(d.kind, d.vessel) for d in found] == [("stenosis", CHANNEL)]
    assert found[0].size_um == pytest.approx(-250, abs=10)
    assert found[0].percent == pytest.approx(-50, abs=2)
    assert found[0].at_mm == pytest.approx(2.0, abs=0.1)


def test_occlusion_is_found_with_its_length_and_a_whole_one_called_missing() -> None:
    found = findings(block(filled=plug(2.3, 3.1), noise=NOISE))
    assert [(d.kind, d.vessel) for d in found.defects] == [("occlusion", CHANNEL)]
    assert found.defects[0].size_um == pytest.approx(800, abs=10)
    assert found.defects[0].at_mm == pytest.approx(2.7, abs=0.02)
    assert found.vessels[CHANNEL].open is False
    assert found.vessels[WIDE].open is True
    assert found.topology.as_designed is False
    assert found.topology.explained is True
    found = findings(block(filled=plug(0.31, 5.29), noise=NOISE))
    assert [(d.kind, d.vessel) for d in found.defects] == [("missing", CHANNEL)]
    assert found.defects[0].size_um == pytest.approx(500)
    assert found.topology.printed.loops == 0
    assert found.topology.explained is True


def test_leak_to_the_outside_and_bridge_between_vessels_are_found_with_their_width() -> None:
    leak = hole((4.5, 3.2, 1.3), (4.5, 3.2, 9.0), 0.12)
    found = findings(block(extra=leak, noise=NOISE))
    assert [(d.kind, d.vessel, d.other) for d in found.defects] == [("leak", WIDE, None)]
    assert found.defects[0].size_um == pytest.approx(240, abs=10)
    assert found.defects[0].at_mm == pytest.approx(2.8, abs=0.1)
    assert found.vessels[WIDE].open is True
    way = hole((5.0, 1.2, 1.3), (5.0, 3.2, 1.3), 0.12)
    found = findings(block(extra=way, noise=NOISE))
    assert [(d.kind, d.vessel, d.other) for d in found.defects] == [("bridge", CHANNEL, WIDE)]
    assert found.defects[0].size_um == pytest.approx(240, abs=10)
    assert found.topology.as_designed is False
    assert found.topology.explained is True


@pytest.mark.slow
def test_defects_on_the_brink_of_what_was_seen_say_so() -> None:
    whole = block(filled=plug(2.3, 5.2), noise=NOISE)
    # The field of view ends 4 mm along the channel.
    field = whole.field
    cut = field.values[:, :, : int((1.7 + 4.0 + 0.4) / 0.05)]
    seen = type(field)(cut, field.level, field.sign, field.voxel_mm, field.origin_mm, 0.0)
    part = Segmentation(seen, whole.surface, whole.outward, whole.seen, whole.contrast, None)
    found = findings(part)
    (defect,) = [d for d in found.defects if d.vessel == CHANNEL]
    assert defect.kind == "occlusion"
    assert defect.from_mm == pytest.approx(2.3, abs=0.02)
    assert not defect.seen
    gauge = found.vessels[WIDE]
    assert gauge.open is None
    assert gauge.seen_fraction < 0.8
    assert gauge.unseen_mm[-1][1] == pytest.approx(gauge.length_mm)
    assert found.topology.as_designed is None


# A joint that fills its crotch is a bulge; a way round gel beside a joint is a bridge.

HEADER = 1
CORNER = np.array([1.7, 1.2, 1.3])
"""Where header and channel meet, at a right angle."""


def beside(*way: object) -> list[Defect]:
    found = findings(block(extra=hole(*way))).defects
    return [one for one in found if {one.vessel, one.other} & {HEADER, CHANNEL}]


@pytest.mark.parametrize("out", first_of([0.75, 0.9]))
def test_a_filled_crotch_is_a_bulge_as_long_as_it_reaches_out(out: float) -> None:
    """On the diagonal the designed walls meet 0.39 mm from the node."""
    tip = CORNER + (out - 0.2) / np.sqrt(2) * np.array([1.0, 1.0, 0.0])
    found = beside(tuple(CORNER), tuple(tip), 0.2)
    assert {one.kind for one in found} == {"bulge"}
    assert max(one.size_um for one in found) == pytest.approx(1e3 * (out - 0.39), abs=70)


def test_a_way_round_gel_beside_the_same_joint_is_a_bridge() -> None:
    found = beside((2.6, 1.2, 1.3), (1.7, 2.1, 1.3), 0.1)
    ways = [(one.kind, one.vessel, one.other) for one in found if one.kind in ("leak", "bridge")]
    assert ways == [("bridge", HEADER, CHANNEL)]


# Wall changes within junctions.

RADIUS, LENGTH, STATIONS, OWN_FROM = 0.22, 4.0, 40, 8


def trace(vessel: int, x: float, *, down: bool = False, free: bool = True) -> VesselTrace:
    """Return an upright vessel, the first stations of which lie within a junction at z = 0."""
    along = (np.arange(STATIONS) + 0.5) * LENGTH / STATIONS
    own = np.arange(STATIONS) >= OWN_FROM
    made: dict[str, Any] = {
        "vessel": vessel,
        "along": along,
        "centre": np.column_stack(
            [np.full(STATIONS, x), np.zeros(STATIONS), -along if down else along]
        ),
        "radius": np.full(STATIONS, RADIUS),
        "counted": own,
        "own": own,
        "apart": own,
        "short": False,
        "sections": SimpleNamespace(open=np.full(STATIONS, free) | ~own),
        "to_end": np.full(STATIONS, np.inf),
        "seen": np.ones(STATIONS, dtype=np.bool_),
        "diameter": np.where(own, 2 * RADIUS, np.nan),
        "spacing": LENGTH / STATIONS,
    }
    return cast(VesselTrace, SimpleNamespace(**made))


def walls(x: float, noise: float, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return points of a vessel's wall, half of them gone within the junction, and their noise."""
    rng = np.random.default_rng(seed)
    angle, z = rng.uniform(0, 2 * np.pi, 12_000), rng.uniform(0, LENGTH, 12_000)
    kept = (z > OWN_FROM * LENGTH / STATIONS) | (angle < np.pi)
    angle, z = angle[kept], z[kept]
    points = np.column_stack([x + RADIUS * np.cos(angle), RADIUS * np.sin(angle), z])
    return points, rng.normal(0, noise, len(z))


def scanned(*, change_mm: float, seed: int = 1, noise: float = 0.015) -> list[Any]:
    first, off = walls(0.0, noise, seed)
    second, clean = walls(3.0, noise, seed + 1)
    at = (first[:, 2] > 0.3) & (first[:, 2] < 0.6)
    off[at] += change_mm / 2
    return find_junction_changes(
        (trace(0, 0.0), trace(1, 3.0)),
        np.vstack([first, second]),
        np.concatenate([off, clean]),
        1e-3,
    )


def test_a_stenosis_that_half_a_wall_shows_is_found_with_place_and_size() -> None:
    (found,) = scanned(change_mm=-0.12)
    assert (found.kind, found.vessel) == ("stenosis", 0)
    assert abs(found.from_mm - 0.3) < 0.11
    assert abs(found.to_mm - 0.6) < 0.11
    assert abs(found.size_um + 60) < max(found.error_um, 8)  # the half that is open has no wall


def test_a_missing_vessel_s_gel_is_no_stenosis_of_the_one_that_it_would_lead_into() -> None:
    """It caps the lumen at its first station: wall 0.09 mm within the junction's design."""
    first, off = walls(0.0, 0.015, 7)
    rng = np.random.default_rng(8)
    turn, rise = rng.uniform(0, 2 * np.pi, 400), rng.uniform(0.01, 0.09, 400)
    cap = np.column_stack([0.15 * np.cos(turn), 0.15 * np.sin(turn), rise])
    points = np.vstack([first[first[:, 2] > 0.3], cap])
    deviation = np.concatenate([off[first[:, 2] > 0.3], np.full(400, -0.09)])
    vessels = trace(0, 0.0), trace(1, 0.0, down=True, free=False)
    assert find_junction_changes(vessels, points, deviation, 1e-3) == []
    printed = trace(0, 0.0), trace(1, 3.0)
    assert [one.kind for one in find_junction_changes(printed, points, deviation, 1e-3)] == [
        "stenosis"
    ]


def test_walls_beyond_a_vessel_s_end_are_another_lumen_s() -> None:
    """A vessel's last station is the nearest to a joint's whole far side, crotch included."""
    first, off = walls(0.0, 0.015, 7)
    angle = np.linspace(0, np.pi, 400)
    beyond = np.column_stack([0.2 * np.cos(angle), 0.2 * np.sin(angle), np.full(400, -0.1)])
    points, deviation = np.vstack([first, beyond]), np.concatenate([off, np.full(400, 0.09)])
    vessels = trace(0, 0.0), trace(1, 3.0)
    assert find_junction_changes(vessels, points, deviation, 1e-3) == []


def test_sizes_of_changes_within_junctions_arent_biased_and_clean_ones_show_nothing() -> None:
    """Twenty of 120 µm, with walls that scatter: the largest stations are 6 % more."""
    found = [
        one for seed in range(0, 40, 2) for one in scanned(change_mm=0.12, seed=seed, noise=0.06)
    ]
    assert len(found) == 20
    assert abs(np.mean([2 * one.wall_um for one in found]) - 120) < 5
    # Half the wall is there: the area changes by half of what a whole wall would change it by.
    assert abs(np.mean([one.size_um for one in found]) - 60) < 5
    assert [one for seed in range(0, 40, 2) for one in scanned(change_mm=0.0, seed=seed)] == []


# Leak paths through speckled gel: faint ones found, shadows and dim gel excluded.


def speckled(
    clean: Segmentation, liquid: float, gel: float = 1.0, seed: int = 0, looks: int = 1
) -> Segmentation:
    """The same part in so many looks of OCT: speckle, exponential of one, light that fades."""
    share = np.asarray(clean.field.values, dtype=np.float64)
    # The phantom's wall is a ramp of 0.3 mm; a voxel is either gel or liquid here.
    power = np.where(share > 0.5, gel, liquid)
    fade = np.exp(-0.02 * np.arange(len(share)))[:, None, None]
    signal = np.random.default_rng(seed).gamma(looks, power * fade / looks).astype(np.float32)
    return replace(clean, strength=Strength(signal, 0.0, signal.astype(np.float16)))


@pytest.mark.parametrize("seed", first_of(range(2)))
def test_a_way_of_200_um_is_found_in_single_look_speckle(seed: int) -> None:
    way = hole((5.0, 1.2, 1.3), (5.0, 3.2, 1.3), 0.10)
    found = findings(speckled(block(extra=way), 0.15, seed=seed)).defects
    kinds = [(d.kind, d.vessel, d.other) for d in found if d.kind in ("leak", "bridge")]
    assert kinds == [("bridge", CHANNEL, WIDE)]
    (bridge,) = (d for d in found if d.kind == "bridge")
    assert abs(bridge.size_um - 200) < bridge.error_um < 80


def with_bubble(scan: Segmentation, x: float, y: float, z: float, radius: float) -> Segmentation:
    """The same with air at a place (mm): it shines on top, and one part in 16 passes it."""
    assert isinstance(scan.field, GelField)
    assert scan.strength is not None
    signal = scan.strength.signal.copy()
    at = (np.array([x, y, z]) - scan.field.origin_mm) / VOXEL
    j, i = np.indices(signal.shape[1:])
    columns = np.hypot(i - at[0], j - at[1]) < radius / VOXEL
    top = round(float(at[2]))
    signal[top, columns] = 40 * np.exp(-0.02 * top)
    signal[top + 1 :, columns] /= 16
    return replace(scan, strength=Strength(signal, 0.0, signal.astype(np.float16)))


def test_a_way_that_nothing_shades_is_a_leak() -> None:
    down = hole((5.0, 1.2, 1.3), (5.0, 1.2, 2.8), 0.10)
    scan = with_bubble(speckled(block(extra=down), 0.15), 6.0, 1.2, 1.3, 0.05)
    ways = [d for d in findings(scan).defects if d.kind in ("leak", "bridge")]
    assert [(d.kind, d.doubt) for d in ways if abs(d.point_mm[0] - 5.0) < 0.2] == [("leak", "")]


def test_light_from_below_gives_the_same_evidence() -> None:
    scan = with_bubble(speckled(block(), 0.15), 5.0, 1.2, 1.3, 0.13)
    assert isinstance(scan.field, GelField)
    assert scan.strength is not None
    whole = gel_evidence(scan.field, scan.strength)
    turned = replace(scan.field, values=np.ascontiguousarray(np.asarray(scan.field.values)[::-1]))
    below = np.ascontiguousarray(scan.strength.signal[::-1])
    signal = Strength(below, 0.0, below.astype(np.float16))
    upwards = gel_evidence(turned, signal, depth_down=False)
    apart = np.abs(np.asarray(upwards.smooth)[::-1] - np.asarray(whole.smooth))
    assert float(np.percentile(apart, 99)) < 0.01
    assert (upwards.glints.down, len(upwards.glints.share)) == (-1, len(whole.glints.share))


@pytest.mark.parametrize("seed", first_of(range(2)))
def test_sound_speckled_gel_has_no_way(seed: int) -> None:
    found = findings(speckled(block(), 0.15, seed=seed)).defects
    assert [d for d in found if d.kind in ("leak", "bridge")] == []


@pytest.mark.slow
def test_a_wide_way_is_gauged_about_its_middle(monkeypatch: pytest.MonkeyPatch) -> None:
    """Though the cheapest path runs along a side of it."""
    aside = np.array([0.12, 0.0, 0.0])
    monkeypatch.setattr(
        leaks,
        "find_gel_paths",
        lambda *given: [replace(way, path=way.path + aside) for way in find_gel_paths(*given)],
    )
    way = hole((5.0, 1.2, 1.3), (5.0, 3.2, 1.3), 0.18)
    found = findings(speckled(block(extra=way), 0.15)).defects
    (bridge,) = (d for d in found if d.kind == "bridge")
    assert bridge.point_mm[0] == pytest.approx(5.0, abs=0.05)
    assert abs(bridge.size_um - 360) < bridge.error_um < 80


def test_lumens_as_bright_as_gel_are_neither_open_nor_closed() -> None:
    found = findings(speckled(block(), 0.95))
    assert [vessel.open for vessel in found.vessels] == [None] * len(found.vessels)
    assert [d for d in found.defects if d.kind in ("missing", "occlusion", "leak", "bridge")] == []
    assert found.contrast.untold == 1.0


# Topology: Betti numbers and overlaps of known shapes.


def torus(tube: float = 3.0) -> np.ndarray:
    z, y, x = np.meshgrid(*(np.arange(-16, 17),) * 3, indexing="ij")
    return np.hypot(np.hypot(x, y) - 10, z) < tube


def ball(radius: float) -> np.ndarray:
    z, y, x = np.meshgrid(*(np.arange(-16, 17),) * 3, indexing="ij")
    return np.sqrt(x**2 + y**2 + z**2) < radius


def test_betti_numbers_of_known_solids() -> None:
    assert betti_numbers(ball(9)) == Betti(1, 0, 0)
    assert betti_numbers(ball(9) & ~ball(5)) == Betti(1, 0, 1)
    assert betti_numbers(torus()) == Betti(1, 1, 0)
    assert betti_numbers(torus() | ball(3)) == Betti(2, 1, 0)
    assert betti_numbers(np.zeros((4, 4, 4), bool)) == Betti(0, 0, 0)
    assert betti_numbers(torus()).euler == 0


@settings(max_examples=examples(40), deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 0.9))
def test_euler_number_agrees_with_scikit_image(seed: int, share: float) -> None:
    voxels = np.random.default_rng(seed).random((6, 7, 5)) < share
    padded = np.pad(voxels, 1)
    assert euler_number(padded) == peer_euler(padded, connectivity=3)


def lying_tube(radius: float, offset: float = 0.0) -> VesselNetwork:
    return polyline([[0.0, 2.2 + offset, 1.3], [9.0, 2.2 + offset, 1.3]], radius)


BOUNDS = np.stack([np.zeros(3), BLOCK])


def bored(radius: float) -> Segmentation:
    """The block with a bore along x alone."""

    def bore(points: np.ndarray) -> np.ndarray:
        return np.hypot(points[..., 1] - 2.2, points[..., 2] - 1.3) - radius

    return block(extra=bore, filled=lambda points: -bore(points))


@pytest.mark.parametrize(("printed", "designed"), [(0.5, 0.5), (0.6, 0.5), (0.4, 0.5)])
def test_volume_ratio_of_scaled_cylinders(printed: float, designed: float) -> None:
    full = bored(printed)
    grid = lay_grid(lying_tube(designed), full.field, IDENTITY, BOUNDS, 0.04, 0.5)
    found = overlap(grid, 0.2)
    assert found.volume_ratio == pytest.approx((printed / designed) ** 2, rel=0.02)
    small, large = sorted((printed, designed))
    dice = 2 * small**2 / (small**2 + large**2)
    assert found.dice == pytest.approx(dice, abs=0.015)
    assert found.designed_mm3 == pytest.approx(np.pi * designed**2 * 9, rel=0.02)


def test_dice_of_offset_cylinders() -> None:
    r, offset = 0.5, 0.2
    full = bored(r)
    grid = lay_grid(lying_tube(r, offset), full.field, IDENTITY, BOUNDS, 0.04, 0.5)
    lens = 2 * r**2 * np.arccos(offset / (2 * r)) - offset / 2 * np.sqrt(4 * r**2 - offset**2)
    assert overlap(grid, 0.4).dice == pytest.approx(lens / (np.pi * r**2), abs=0.015)
    assert scanned_with(grid, full.field, IDENTITY).free.sum() == grid.free.sum()
