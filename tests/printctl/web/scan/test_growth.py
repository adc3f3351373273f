"""Decompression bombs: scans that unpack to far more than was sent are refused."""

from __future__ import annotations

import gzip
import zipfile
import zlib
from pathlib import Path

import pytest

from printctl.web.errors import BadRequestError
from printctl.web.scan import unpacked_size
from printctl.web.scan.unpacked_size import refuse_growth
from printctl.web.scan.unpacking import unpack_stack

MOST = 10**10
SIZE = 2_600_000


def zeros(level: int = 31) -> bytes:
    packer = zlib.compressobj(9, zlib.DEFLATED, level)
    piece = bytes(100_000)
    return b"".join(packer.compress(piece) for _ in range(SIZE // 10**5)) + packer.flush()


@pytest.fixture(autouse=True)
def _growth_is_looked_at_early(monkeypatch: pytest.MonkeyPatch) -> None:
    """From 2 MB on, not from 200: to pack what grows so far takes seconds."""
    monkeypatch.setattr(unpacked_size, "_RATIO_FROM", 2_000_000)


@pytest.fixture(scope="module")
def packed() -> bytes:
    return zeros()


def test_a_gzip_that_grows_is_refused(tmp_path: Path, packed: bytes) -> None:
    (tmp_path / "scan.nii.gz").write_bytes(packed)
    with pytest.raises(BadRequestError, match="more than 200 times its size"):
        refuse_growth(tmp_path / "scan.nii.gz", MOST)


def test_what_follows_a_small_gzip_stream_counts_as_well(tmp_path: Path, packed: bytes) -> None:
    (tmp_path / "scan.nii.gz").write_bytes(gzip.compress(b"first") + packed)
    with pytest.raises(BadRequestError, match="more than 200 times its size"):
        refuse_growth(tmp_path / "scan.nii.gz", MOST)


def test_an_nrrd_with_gzip_inside_is_refused(tmp_path: Path, packed: bytes) -> None:
    head = b"NRRD0004\ntype: uint8\nencoding: gzip\n\n"
    (tmp_path / "scan.nrrd").write_bytes(head + packed)
    with pytest.raises(BadRequestError, match="more than 200 times its size"):
        refuse_growth(tmp_path / "scan.nrrd", MOST)


def test_zips_that_grow_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "scan.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("slice.tif", bytes(SIZE))
    with pytest.raises(BadRequestError, match="more than 200 times its size"):
        refuse_growth(path, MOST)
    with pytest.raises(BadRequestError, match="more than 200 times its size"):
        unpack_stack(path, tmp_path / "out", MOST)


def test_more_than_is_taken_is_refused_at_any_ratio(tmp_path: Path) -> None:
    (tmp_path / "scan.nii.gz").write_bytes(gzip.compress(bytes(range(256)) * 8000))
    with pytest.raises(BadRequestError, match="at most 1 MB"):
        refuse_growth(tmp_path / "scan.nii.gz", 10**6)


def test_plain_and_broken_files_are_left_to_their_readers(tmp_path: Path) -> None:
    for data in (b"II*\x00", b"\x1f\x8bbroken", b"PK\x03\x04broken", gzip.compress(b"scan")):
        (tmp_path / "scan").write_bytes(data)
        refuse_growth(tmp_path / "scan", MOST)
