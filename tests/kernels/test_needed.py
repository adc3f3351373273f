"""List of needed kernels: types round-trip, entries exist."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from numba.core import types

from design.geometry.bvh import TriangleTree
from kernels.key import signature_text
from kernels.needed import NeededKernel, needed_kernels, resolve_name, types_of, types_text, write
from tests.kernels.record import WORKS

RECORD = numba.from_dtype(
    np.dtype([("at", "<f8", (3,)), ("line", "<i8"), ("seen", "?")], align=True)
)
PACKED = numba.from_dtype(np.dtype([("load", "<f8"), ("parent", "<i4")]))
TREE = types.BaseTuple.from_types([types.float64[:, ::1]] * len(TriangleTree._fields), TriangleTree)


@pytest.mark.parametrize(
    "signature",
    [
        (types.int64, types.float32, types.boolean, types.none, types.uint8),
        (types.float64[:, :, ::1], types.Array(types.int32, 2, "F"), types.int8[:]),
        (types.Array(types.float64, 1, "C", readonly=True), types.Bytes(types.uint8, 1, "C")),
        (types.UniTuple(types.int64, 3), types.Tuple([types.int64, types.float64[::1]])),
        (TREE, types.UniTuple(TREE, 2)),
        (types.Array(RECORD, 1, "C"), RECORD),
        (types.Array(PACKED, 1, "C"), PACKED, types.UniTuple(PACKED, 2)),
        (types.complex128[::1], types.complex64),
    ],
)
def test_types_come_back_as_they_were(signature) -> None:
    again = types_of(types_text(signature))
    assert again == signature
    assert signature_text(again, {}) == signature_text(signature, {})


@pytest.mark.parametrize(
    "one",
    [
        types.literal(3),
        types.unicode_type,
        types.List(types.int64),
        types.Array(types.float64, 1, "C", aligned=False),
    ],
)
def test_what_the_list_cant_hold_is_said(one) -> None:
    with pytest.raises(TypeError, match="can't hold"):
        types_text([one])


def test_each_listed_kernel_is_there_with_its_types() -> None:
    """Else ``python -m tests.kernels.record`` makes the list anew."""
    rows = needed_kernels()
    assert len(rows) > 400
    assert {work for one in rows for work in one.by} == set(WORKS)
    for one in rows:
        assert callable(resolve_name(one.kernel).py_func), one.kernel
        assert types_text(types_of(one.takes)) == one.takes


def test_a_list_is_read_by_works(tmp_path, monkeypatch) -> None:
    one = NeededKernel(
        "sim.gcode.motion.planner:plan", types_text([types.int64]), frozenset({"a", "b"})
    )
    other = NeededKernel(
        "sim.gcode.motion.planner:plan", types_text([types.float64]), frozenset({"b"})
    )
    path = tmp_path / "list.jsonl"
    write([one, other], path)
    monkeypatch.setattr("kernels.needed.LIST", path)
    assert needed_kernels() == [one, other] == needed_kernels("b") == needed_kernels("a", "b")
    assert needed_kernels("a") == [one]
    assert needed_kernels("c") == []
    monkeypatch.setattr("kernels.needed.LIST", tmp_path / "none")
    assert needed_kernels() == []
