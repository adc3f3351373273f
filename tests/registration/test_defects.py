"""Planted defects of known place and size are found; none in clean phantoms."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from kernels.arrays import FloatArray
from registration.alignment import Alignment, Uncertainty
from registration.alignment.distance import ModelSurface
from registration.alignment.uncertainty import ScanErrors
from registration.findings import Findings, Inspection, inspect
from registration.measuring.gauging import deviations
from registration.measuring.gauging.defect import Defect
from registration.measuring.gauging.junctions import find_junction_changes
from registration.measuring.gauging.trace import VesselTrace
from registration.segmentation import Segmentation, gel_evidence
from tests.registration.phantom import (
    CHANNEL,
    IDENTITY,
    WIDE,
    block,
    ladder,
    ladder_construct,
)
from tests.slower import first_of

NOISE = 0.004
ERRORS = ScanErrors(0.005, 0.005, 0.0, 50.0, 0.0, 0.0, 0.04, np.array([0.0, 0.0, 1.0]))
SURE = Uncertainty(np.zeros(3), np.zeros(3), np.zeros(3), 0.0)


def findings(segmentation: Segmentation) -> Findings:
    surface = ModelSurface.of(ladder_construct())
    deviation = deviations(surface, segmentation.surface.vertices, False)
    fits = Alignment(IDENTITY, IDENTITY, 2, True, np.inf, (), SURE, "upright", ())
    network = ladder()
    evidence = gel_evidence(segmentation.field, segmentation.strength)
    return inspect(
        Inspection(
            network,
            surface,
            False,
            segmentation,
            fits,
            deviation,
            0.1,
            1e-3,
            None,
            ERRORS,
            evidence,
        )
    )


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


def test_occlusion_is_found_with_its_length() -> None:
    found = findings(block(filled=plug(2.3, 3.1), noise=NOISE))
    assert [(d.kind, d.vessel) for d in found.defects] == [("occlusion", CHANNEL)]
    assert found.defects[0].size_um == pytest.approx(800, abs=10)
    assert found.defects[0].at_mm == pytest.approx(2.7, abs=0.02)
    assert found.vessels[CHANNEL].open is False
    assert found.vessels[WIDE].open is True
    assert found.topology.as_designed is False
    assert found.topology.explained is True


def test_missing_vessel_is_called_missing() -> None:
    found = findings(block(filled=plug(0.31, 5.29), noise=NOISE))
    assert [(d.kind, d.vessel) for d in found.defects] == [("missing", CHANNEL)]
    assert found.defects[0].size_um == pytest.approx(500)
    assert found.topology.printed.loops == 0
    assert found.topology.explained is True


def test_leak_to_the_outside_is_found_with_its_width() -> None:
    leak = hole((4.5, 3.2, 1.3), (4.5, 3.2, 9.0), 0.12)
    found = findings(block(extra=leak, noise=NOISE))
    assert [(d.kind, d.vessel, d.other) for d in found.defects] == [("leak", WIDE, None)]
    assert found.defects[0].size_um == pytest.approx(240, abs=10)
    assert found.defects[0].at_mm == pytest.approx(2.8, abs=0.1)
    assert found.vessels[WIDE].open is True


def test_bridge_between_vessels_is_found_with_its_width() -> None:
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
    ways = [(one.kind, one.vessel, one.other) for one in found if one.through_gel]
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
    assert abs(found.size_um + 120) < max(found.error_um, 10)


def test_a_missing_vessel_s_gel_is_no_stenosis_of_the_one_that_it_would_lead_into() -> None:
    """It caps the lumen below its first station: wall 0.09 mm within the junction's design."""
    first, off = walls(0.0, 0.015, 7)
    rng = np.random.default_rng(8)
    turn, rise = rng.uniform(0, 2 * np.pi, 400), rng.uniform(-0.14, -0.05, 400)
    cap = np.column_stack([0.15 * np.cos(turn), 0.15 * np.sin(turn), rise])
    points = np.vstack([first[first[:, 2] > 0.3], cap])
    deviation = np.concatenate([off[first[:, 2] > 0.3], np.full(400, -0.09)])
    vessels = trace(0, 0.0), trace(1, 0.0, down=True, free=False)
    assert find_junction_changes(vessels, points, deviation, 1e-3) == []
    printed = trace(0, 0.0), trace(1, 3.0)
    assert [one.kind for one in find_junction_changes(printed, points, deviation, 1e-3)] == [
        "stenosis"
    ]


def test_sizes_of_changes_within_junctions_arent_biased() -> None:
    """Twenty of 120 µm, with walls that scatter: the largest stations are 6 % more."""
    found = [
        one for seed in range(0, 40, 2) for one in scanned(change_mm=0.12, seed=seed, noise=0.06)
    ]
    assert len(found) == 20
    assert abs(np.mean([one.size_um for one in found]) - 120) < 5


def test_a_clean_junction_shows_nothing() -> None:
    assert [one for seed in range(0, 40, 2) for one in scanned(change_mm=0.0, seed=seed)] == []
