"""Wall changes within junctions."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from kernels.arrays import FloatArray
from registration.measuring.gauging.junctions import find_junction_changes
from registration.measuring.gauging.trace import VesselTrace
from registration.measuring.gauging.vessels import VesselGauge

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


def test_a_bulge_is_a_bulge() -> None:
    (found,) = scanned(change_mm=0.1)
    assert found.kind == "bulge"


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


def test_a_clean_junction_shows_nothing() -> None:
    assert [one for seed in range(0, 40, 2) for one in scanned(change_mm=0.0, seed=seed)] == []


def gauged(vessel: int) -> VesselGauge:
    """A vessel of which only the resistance counts here."""
    fields: dict[str, Any] = {field.name: None for field in dataclasses.fields(VesselGauge)}
    fields |= {"vessel": vessel, "resistance_ratio": 0.93, "resistance_ratio_95": (0.85, 1.02)}
    return VesselGauge(**fields)
