"""Parallel kernel compilation in other processes before first use."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from kernels.in_advance import compile_in_advance, missing
from kernels.needed import NeededKernel, needed_kernels

WRONG = NeededKernel("design.geometry.bvh:not_there", "[]", frozenset())


@pytest.fixture
def rows(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[NeededKernel]:
    """Two small kernels of the list, and an empty store."""
    monkeypatch.setenv("PRINTCTL_CACHE", str(tmp_path))
    return needed_kernels()[:2]


def test_what_is_compiled_is_no_longer_missing(rows: list[NeededKernel], tmp_path: Path) -> None:
    assert missing(rows) == rows
    told: list[int] = []
    assert compile_in_advance([*rows, WRONG], told.append) == 1
    assert told == [1, 2, 3]
    assert len(list(tmp_path.rglob("*.nbc"))) >= 2
    assert missing(rows) == []
    _make_older(tmp_path)
    assert missing(rows) == rows, "the sources are younger"
    assert compile_in_advance(rows) == 0
    assert missing(rows) == [], "looked at again, and nothing to do"


def _make_older(folder: Path) -> None:
    for file in folder.rglob("*.nbc"):
        os.utime(file, (1, 1))


def test_a_second_kind_of_arguments_is_missing_alone(rows: list[NeededKernel]) -> None:
    compile_in_advance(rows[:1])
    other = NeededKernel(rows[0].kernel, "[]", frozenset())
    assert missing([rows[0], other]) == [rows[0], other]
    assert missing(rows[:1]) == []
