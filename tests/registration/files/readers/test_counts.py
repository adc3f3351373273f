"""Grey values that encode dB, saturation, and confused scales."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from registration import Scan, ScanOverrides, read_scan, write_scan_tiff
from registration.errors import ScanFileError
from registration.files.readers.decibels import speckle_of

KNOWN: dict[str, Any] = {
    "axes": "zyx", "voxel_mm": [0.01, 0.02, 0.03], "modality": "oct", "optical_depth": True,
    "refractive_index": 1.34, "scale": "db",
}  # fmt: skip


def speckled(looks: int = 1, ratio: float = 100.0) -> NDArray[np.float64]:
    """Linear intensity of speckle (gamma law), dark liquid above bright gel, as z, y, x."""
    rng = np.random.default_rng(3)
    volume = rng.gamma(looks, 1 / looks, (40, 40, 40))
    volume[:20] /= ratio
    return volume


def in_db(volume: NDArray[np.float64]) -> NDArray[np.float64]:
    return 10 * np.log10(np.maximum(volume, 1e-9))


def raw(path: Path, volume: NDArray[Any], **said: Any) -> Path:
    """A raw file with its sidecar."""
    beside = {**KNOWN, "shape": list(volume.shape), "dtype": volume.dtype.name, **said}
    if volume.dtype.itemsize > 1:
        beside["byte_order"] = "little"
    beside = {name: value for name, value in beside.items() if value is not None}
    path.with_suffix(".yaml").write_text(yaml.safe_dump(beside))
    path.write_bytes(volume.tobytes())
    return path


def to_counts(db: NDArray[np.float64], kind: str = "uint8") -> NDArray[Any]:
    """-40 to +20 dB over the range of a type, clipped."""
    info = np.iinfo(kind)
    share = np.clip((db + 40) / 60, 0, 1)
    return np.round(share * (int(info.max) - int(info.min)) + int(info.min)).astype(kind)


@pytest.mark.parametrize("kind", ["uint8", "int8", "uint16", "int16"])
def test_counts_of_a_window_become_decibels(tmp_path: Path, kind: str) -> None:
    db = in_db(speckled())
    path = raw(tmp_path / "s.raw", to_counts(db, kind), db_range=[-40, 20])
    found = read_scan(path)
    assert (found.volume.dtype, found.scale) == (np.float32, "db")
    np.testing.assert_allclose(found.volume, np.clip(db, -40, 20), atol=0.51 * 60 / 255)


def test_a_window_over_other_counts_and_a_slope_say_the_same(tmp_path: Path) -> None:
    counts = np.round(np.clip((in_db(speckled()) + 40) / 60, 0, 1) * 4095).astype("<u2")
    window = raw(tmp_path / "a.raw", counts, db_range=[-40, 20], count_range=[0, 4095])
    slope = raw(tmp_path / "b.raw", counts, counts_per_db=4095 / 60, db_at_zero=-40)
    np.testing.assert_allclose(read_scan(window).volume, read_scan(slope).volume, atol=1e-4)
    # An option's description replaces the sidecar's.
    said = ScanOverrides(db_range=(0, 60), count_range=(0, 4095))
    moved = read_scan(slope, said).volume - read_scan(slope).volume
    np.testing.assert_allclose(moved, 40, atol=1e-4)


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        ({}, "--db-range LOW,HIGH"),
        ({"db_range": [20, -40]}, "the lower one first"),
        ({"db_range": [0, 255]}, "spans 255 dB"),
        ({"db_range": [-40, 20], "counts_per_db": 4}, "not both"),
        ({"count_range": [0, 255]}, "without db_range"),
        ({"db_at_zero": 3}, "without counts_per_db"),
        ({"counts_per_db": 0}, "above 0"),
        ({"db_range": [-40, 20], "count_range": [0, 100]}, "beyond count_range"),
        ({"db_range": [-40, 20], "scale": "linear"}, "the scale is 'linear'"),
    ],
)
def test_counts_that_nobody_describes_are_refused(tmp_path, said, reason):
    with pytest.raises(ScanFileError, match=reason):
        read_scan(raw(tmp_path / "s.raw", to_counts(in_db(speckled())), **said))


def test_whole_decibels_come_back_from_our_own_files(tmp_path: Path) -> None:
    volume = np.round(in_db(speckled())).astype(np.int16)
    scan = Scan(volume, (0.01, 0.02, 0.03), 1.34, True, "db", "oct", True, tmp_path)
    write_scan_tiff(tmp_path / "s.tif", scan)
    np.testing.assert_array_equal(read_scan(tmp_path / "s.tif").volume, volume)


@pytest.mark.parametrize("looks", [1, 4, 16])
@pytest.mark.parametrize("ratio", [3.0, 100.0])
def test_speckle_tells_the_scales_apart(looks: int, ratio: float) -> None:
    """Linear: spread grows as brightness, skewness 2 / √looks; dB: spread alike."""
    linear = speckled(looks, ratio).reshape(1000, 64)
    measured = speckle_of(linear)
    assert measured is not None
    assert measured.growth == pytest.approx(1, abs=0.1)
    assert measured.bright_spread / measured.bright == pytest.approx(looks**-0.5, rel=0.1)
    db = speckle_of(in_db(linear) + 60)
    assert db is not None
    assert (
        abs(np.log(db.bright_spread / db.dark_spread)) < 0.25
    )  # bright places are those without dark speckles
    assert db.skewness < 0.1
    if looks == 1:
        assert db.bright_spread == pytest.approx(5.57, rel=0.15)


@pytest.mark.parametrize("looks", [1, 4])
def test_decibels_given_as_linear_are_asked_about(tmp_path: Path, looks: int) -> None:
    counts = to_counts(in_db(speckled(looks)))
    path = raw(tmp_path / "s.raw", counts, scale="linear")
    with pytest.raises(ScanFileError, match=r"looks like dB: it spreads by .* --db-range"):
        read_scan(path)
    insisted = read_scan(path, ScanOverrides(scale="linear"))
    assert "looks like dB" in insisted.notes[-1]
    np.testing.assert_array_equal(insisted.volume, counts)


@pytest.mark.parametrize("looks", [1, 4])
@pytest.mark.parametrize("factor", [1.0, 1e4])
def test_linear_given_as_decibels_is_asked_about(tmp_path: Path, looks: int, factor: float) -> None:
    path = raw(tmp_path / "s.raw", (factor * speckled(looks)).astype("<f4"))
    with pytest.raises(ScanFileError, match=r"looks linear: .* --scale linear"):
        read_scan(path)
    assert "looks linear" in read_scan(path, ScanOverrides(scale="db")).notes[-1]


def test_saturated_voxels_are_told_with_their_share_and_refused_beyond_it(tmp_path: Path) -> None:
    """Exponential speckle cut at c times the gel's mean: exp(-c) of the gel, half the volume."""
    some = np.minimum(speckled(), -np.log(0.04))
    found = read_scan(raw(tmp_path / "a.raw", some.astype("<f4"), scale="linear"))
    assert found.notes[0].startswith(f"{100 * (some == some.max()).mean():.1f}"[0])
    assert "saturated" in found.notes[0]
    many = np.minimum(speckled(), -np.log(0.3))
    with pytest.raises(ScanFileError, match=r"1[3-7] % of its voxels are saturated .*limit 10 %"):
        read_scan(raw(tmp_path / "b.raw", many.astype("<f4"), scale="linear"))
