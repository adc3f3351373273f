"""Names that numba's object files define."""

from __future__ import annotations

import os
import sys

import pytest

from kernels.object_file import UnloadableError, defined_names
from kernels.with_numba import compiled


@pytest.mark.skipif(
    sys.platform != "linux" or os.uname().machine != "x86_64",
    reason="machine code is read by the product on Linux on x86-64 alone",
)
def test_a_kernels_file_defines_its_entries_and_not_what_it_calls(
    monkeypatch: pytest.MonkeyPatch, tmp_path: os.PathLike[str]
) -> None:
    monkeypatch.setenv("PRINTCTL_CACHE", str(tmp_path))

    @compiled
    def root(x: float) -> float:
        if x < 0:
            raise ValueError("below zero")
        return x**0.5

    assert root(4.0) == 2.0
    (made,) = root.overloads.values()  # type: ignore[attr-defined]
    names = defined_names(made.library._get_compiled_object())
    assert {made.fndesc.llvm_func_name, made.fndesc.llvm_cpython_wrapper_name} <= names
    assert not {name for name in names if name.startswith(("Py", "NRT_"))}


def test_a_file_of_another_system_is_refused() -> None:
    with pytest.raises(UnloadableError):
        defined_names(b"\xcf\xfa\xed\xfe" + bytes(100))
