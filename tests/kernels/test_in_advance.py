"""Parallel kernel compilation in other processes before first use."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from kernels import under_way
from kernels.in_advance import compiling, missing
from kernels.needed import NeededKernel, needed_kernels, resolve_name, types_of
from kernels.stored import KernelStore

WRONG = NeededKernel("design.geometry.bvh:not_there", "[]", frozenset())


@pytest.fixture
def rows(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[NeededKernel]:
    """Two small kernels of the list, and an empty store."""
    monkeypatch.setenv("PRINTCTL_CACHE", str(tmp_path))
    return needed_kernels()[:2]


@pytest.mark.slow
def test_what_is_compiled_is_no_longer_missing(rows: list[NeededKernel], tmp_path: Path) -> None:
    assert missing(rows) == rows
    told: list[int] = []
    with compiling([*rows, WRONG], (), told.append) as failed:
        assert failed == 1
    assert told == [1, 2, 3]
    assert len(list(tmp_path.rglob("*.nbc"))) >= 2
    assert missing(rows) == []
    _make_older(tmp_path)
    assert missing(rows) == rows, "the sources are younger"
    with compiling(rows, ()) as failed:
        assert failed == 0
    assert missing(rows) == [], "looked at again, and nothing to do"


def _make_older(folder: Path) -> None:
    for file in folder.rglob("*.nbc"):
        os.utime(file, (1, 1))


@pytest.mark.slow
def test_a_second_kind_of_arguments_is_missing_alone(rows: list[NeededKernel]) -> None:
    with compiling(rows[:1], ()):
        pass
    other = NeededKernel(rows[0].kernel, "[]", frozenset())
    assert missing([rows[0], other]) == [rows[0], other]
    assert missing(rows[:1]) == []


def test_a_call_waits_for_a_kernel_that_is_compiled_beside(
    rows: list[NeededKernel], monkeypatch: pytest.MonkeyPatch
) -> None:
    compiled: list[str] = []
    monkeypatch.setattr(KernelStore, "save_overload", lambda store, sig, data: compiled.append(""))
    one = rows[0]
    with compiling((), [one]) as failed:
        assert failed == 0
        resolve_name(one.kernel).compile_for_kernels(types_of(one.takes))
    assert not compiled, "it was loaded, not compiled a second time"
    assert not missing([one])


def test_what_is_not_begun_when_the_work_ends_is_given_up(rows: list[NeededKernel]) -> None:
    many = [*rows, *(NeededKernel(one.kernel, one.takes, one.by) for one in rows * 20)]
    with pytest.raises(ValueError, match="the work failed"), compiling((), many):
        raise ValueError("the work failed")
    assert not under_way.waited_for(rows[0].kernel, types_of(rows[0].takes))
