"""Atomic file writing: a failed write leaves the old file."""

import errno
from pathlib import Path

import pytest

from design.files import atomic_replacement, write_text


def test_success_replaces_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "sub" / "a.txt"
    write_text(path, "old")
    write_text(path, "new")
    assert path.read_text() == "new"
    assert [entry.name for entry in path.parent.iterdir()] == ["a.txt"]


def test_full_disk_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old")
    with pytest.raises(OSError, match=r"full: .*a\.txt"), atomic_replacement(path) as draft:
        draft.write_text("half")
        raise OSError(errno.ENOSPC, "disk full")
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.txt"]
