"""Leak paths through speckled gel: faint ones found, shadows and dim gel excluded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from registration.measuring.topology import leaks
from registration.measuring.topology.gel_paths import find_gel_paths
from registration.segmentation import GelField, Segmentation, gel_evidence
from registration.segmentation.volume import Strength
from tests.registration.phantom import CHANNEL, VOXEL, WIDE, block
from tests.registration.test_defects import findings, hole
from tests.slower import first_of


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
