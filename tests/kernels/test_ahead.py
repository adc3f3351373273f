"""Kernels compiled ahead: the list, and the processes that compile it."""

from __future__ import annotations

import json
import time
from importlib import import_module

import pytest
from numba import types

from design.geometry.bvh import TriangleTree
from kernels import folder
from kernels.ahead import NeededKernel, compiling, missing, needed_kernels, numba_type
from tests.kernels.record import WORKS, described

TREE = types.BaseTuple.from_types([types.float64[:, ::1]] * len(TriangleTree._fields), TriangleTree)


@pytest.mark.parametrize(
    "one",
    [
        types.int64,
        types.boolean,
        types.none,
        types.Array(types.int32, 2, "F"),
        types.Array(types.float64, 1, "C", readonly=True),
        types.Bytes(types.uint8, 1, "C"),
        types.Tuple([types.int64, types.float64[::1]]),
        types.UniTuple(TREE, 2),
    ],
)
def test_types_come_back_as_they_were(one) -> None:
    assert numba_type(json.loads(json.dumps(described(one)))) == one


def test_each_listed_kernel_is_there_with_its_types() -> None:
    """Else ``python -m tests.kernels.record`` makes the list anew."""
    rows = needed_kernels()
    assert len(rows) > 400
    assert {work for one in rows for work in one.by} <= set(WORKS)
    for one in rows:
        module, _, name = one.kernel.partition(":")
        assert callable(getattr(import_module(module), name).py_func), one.kernel
        assert [described(numba_type(data)) for data in json.loads(one.takes)] == json.loads(
            one.takes
        )


def test_what_is_compiled_ahead_is_missing_no_more(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("PRINTCTL_CACHE", str(tmp_path))
    folder._made.cache_clear()
    row = next(
        one for one in needed_kernels() if one.kernel == "design.geometry.crossings:plane_side"
    )
    wrong = NeededKernel("design.geometry.crossings:nothing", row.takes, row.by)
    late = next(
        one for one in needed_kernels() if one.kernel == "design.geometry.crossings:meeting_kind"
    )
    done: list[int] = []
    with compiling([row, wrong], [late], done.append) as failed:
        assert (failed, done) == (1, [1, 2])
        while not list(tmp_path.rglob("*meeting_kind*.nbc")):
            time.sleep(0.05)
    assert missing([row, wrong]) == [wrong]
    assert list(tmp_path.rglob("*plane_side*"))
    folder._made.cache_clear()
