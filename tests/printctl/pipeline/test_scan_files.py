"""A run's memory of the user's scan: any change of it makes the stage run again."""

from __future__ import annotations

from pathlib import Path

from printctl.pipeline.stages.scan import digest_scan
from registration.writers import write_scan_zarr
from tests.registration.readers.crafted import counts, scan


def test_every_file_of_a_folder_counts(tmp_path: Path) -> None:
    path = tmp_path / "s.zarr"
    write_scan_zarr(path, scan())
    before = digest_scan(path)
    write_scan_zarr(path, scan(volume=counts() + 1))
    assert digest_scan(path) != before


def test_the_scans_of_a_list_count(tmp_path: Path) -> None:
    path = tmp_path / "all.yaml"
    entries = "[{file: a.tif, at_mm: [0, 0, 0]}, {file: all.yaml, at_mm: [1, 0, 0]}]"
    path.write_text("{mosaic: tiles, scans: " + entries + "}")
    assert digest_scan(path)[1] == ""
    (tmp_path / "a.tif").write_bytes(b"1")
    before = digest_scan(path)
    (tmp_path / "a.tif").write_bytes(b"2")
    assert digest_scan(path) != before


def test_what_isnt_there_or_isnt_a_list_has_a_digest_too(tmp_path: Path) -> None:
    assert digest_scan(tmp_path / "none.tif") == [""]
    (tmp_path / "s.yaml").write_text("nonsense")
    assert len(digest_scan(tmp_path / "s.yaml")) == 1
